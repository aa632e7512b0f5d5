"""Tries to compile what must not compile: each line must be an error, and the compiler must name the concept that it breaks.

usage: check_refusals.py --compiler c++ --include DIR…
The first include folder is lumo's own; the others are taken as system folders. The same lines with sound types must compile.
"""
import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

FLAGS = ["-std=c++20", "-fsyntax-only"]
PREAMBLE = """#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/mechanics/oriented.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/vertex_block_descent.hpp"
using namespace lumo;
struct Soft {};                                  // nothing of a material
struct Inward {                                  // a contact law without validate
  double stiffness_N_per_m3 = 1e9;
  ContactResponse respond(double) const { return {}; }
};
struct FivePoints : LinearTet {                  // an element of no order
  static constexpr int order = 3;
};
struct Blunt {                                   // a tool without derivatives
  double distance(const Vec3&) const { return 1.0; }
  double radius_m() const { return 1.0; }
};
struct Still {                                   // a solver that finds nothing
  template <class, class, class>
  using Model = int;
  static constexpr bool uses_symmetry = false;
};
"""
# What is wrong, the same in sound types, and the concept.
CASES = [
    ("Simulator<int, SDFContact> s;", "Simulator<NeoHookean, SDFContact> s;", "HyperelasticMaterial"),
    ("Simulator<Soft, SDFContact> s;", "Simulator<NeoHookean, SDFContact, LinearTet> s;", "HyperelasticMaterial"),
    ("Simulator<NeoHookean, NeoHookean> s;", "Simulator<NeoHookean, SDFContact> s;", "ContactHandler"),
    ("Simulator<NeoHookean, Inward> s;", "Simulator<NeoHookean, SDFContact> s;", "ContactHandler"),
    ("Simulator<NeoHookean, SDFContact, FivePoints> s;", "Simulator<NeoHookean, SDFContact, LinearTet> s;", "TetElement"),
    ("Simulator<NeoHookean, SDFContact, QuadraticTet, double> s;", "Simulator<NeoHookean, SDFContact, QuadraticTet, EigenCholesky> s;", "PressSolver"),
    ("Simulator<NeoHookean, SDFContact, LinearTet, Still> s;", "Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent> s;", "PressSolver"),
    ("QuasiStatic<int> s;", "QuasiStatic<EigenCholesky> s;", "LinearSolver"),
    ("BlockDescent<int> s;", "BlockDescent<Serial> s;", "Executor"),
    ("Scenario<Blunt> s;", "Scenario<Sphere> s;", "Indenter"),
    ("Oriented<Blunt> s;", "Oriented<Sphere> s;", "Indenter"),
    ("VertexLanes<Soft>* s;", "VertexLanes<NeoHookean>* s;", "DilatationalMaterial"),
]


ERROR = re.compile(r"^[^ ]*bad\.cpp:(\d+):\d+: error:")


def compile_lines(command, scratch, name, lines):
    source = pathlib.Path(scratch) / name
    source.write_text(PREAMBLE + "\n".join(f"namespace n{k} {{ {line} }}" for k, line in enumerate(lines)) + "\n", encoding="utf-8")
    done = subprocess.run([*command, str(source)], capture_output=True, text=True)
    return done.returncode, done.stderr


def check(compiler, folders):
    command = [compiler, *FLAGS, "-I", str(folders[0])]
    for folder in folders[1:]:
        command += ["-isystem", folder]
    first, faults = PREAMBLE.count("\n") + 1, []
    with tempfile.TemporaryDirectory() as scratch:
        code, errors = compile_lines(command, scratch, "sound.cpp", [good for _, good, _ in CASES])
        if code != 0:
            return [f"the sound lines do not compile:\n{errors}"]
        for begin in range(0, len(CASES), 6):   # clang gives up after twenty errors
            cases = CASES[begin:begin + 6]
            _, errors = compile_lines(command, scratch, "bad.cpp", [bad for bad, _, _ in cases])
            said, at = {}, None   # line -> its errors with their notes
            for line in errors.splitlines():
                match = ERROR.match(line)
                at = int(match.group(1)) if match else at
                said[at] = said.get(at, "") + line + "\n"
            for k, (bad, _, concept) in enumerate(cases):
                if first + k not in said:
                    faults.append(f"compiles, but must not: {bad}")
                elif concept not in said[first + k]:
                    faults.append(f"'{bad}' is refused without a word of {concept}:\n{said[first + k]}")
    return faults


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    arguments = parser.parse_args()
    found = check(arguments.compiler, arguments.include)
    print("\n".join(found) if found else f"{len(CASES)} lines are refused by name")
    sys.exit(1 if found else 0)
