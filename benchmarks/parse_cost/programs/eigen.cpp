#include <Eigen/Dense>
#include <Eigen/Sparse>

int main() {}
