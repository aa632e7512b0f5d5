#include "lumo/support/cholmod.hpp"

#include "version.hpp"

#include <cmath>

int main() {
  lumo::SparseLower lower(2, 2);  // 4 2; 2 5
  lower.insert(0, 0) = 4.0;
  lower.insert(1, 0) = 2.0;
  lower.insert(1, 1) = 5.0;
  lower.makeCompressed();
  lumo::Cholmod solver;
  solver.analyze(lower);
  if (solver.factorize(lower) != lumo::FactorStatus::positive_definite) return 1;
  const Eigen::MatrixXd x = solver.solve(Eigen::Vector2d(8.0, 12.0));
  return std::abs(x(0) - 1.0) < 1e-12 && std::abs(x(1) - 2.0) < 1e-12 && openblas_set_num_threads && is_wanted_version()
             ? 0
             : 1;
}
