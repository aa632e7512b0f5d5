#include "lumo/lumo.hpp"

int main() {}
