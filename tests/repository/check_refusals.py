"""Tries to compile what must not compile: each line must be an error, and the compiler must name the concept that it
breaks.

usage: check_refusals.py --compiler c++ --include DIR…
The first include folder is lumo's own; the others are taken as system folders. The same lines with sound
types must compile.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

FLAGS = ["-std=c++20", "-fsyntax-only"]
# Groups of cases, each with what it includes and declares. A case: what is wrong, the same in sound types, and the
# concept.
MECHANICS = """#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
using namespace lumo;
struct Soft {};                                  // nothing of a material
struct Inward {                                  // a contact law without validate
  double stiffness_N_per_m3 = 1e9;
  ContactResponse<double> respond(double) const { return {}; }
};
struct FivePoints : LinearTet {                  // an element of no order
  static constexpr int order = 3;
};
struct Blunt {                                   // a tool without derivatives
  double distance(const Vec3d&) const { return 1.0; }
  double radius_m() const { return 1.0; }
};
struct Still {                                   // a solver that finds nothing
  template <class, class, class>
  using Model = int;
  static constexpr bool uses_symmetry = false;
};
"""
LIGHT = """#include "lumo/pipeline/observe.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/tracer.hpp"
using namespace lumo;
struct Fog {                                     // a medium without an index
  explicit Fog(const Medium&) {}
  double transmittance(double) const { return 0.5; }
};
struct Blind {                                   // a readout that says nothing of a ray
  int channels(const Body&) const { return 1; }
};
struct Lamp {                                    // an emitter that cannot be mirrored
  Vec3d center;
  double power_W;
  int channel;
  Vec3d axis() const { return center; }
  Vec3d point(double, double) const { return center; }
  Polar polar(double) const { return {}; }
};
struct Sieve {                                   // a mesher that fills nothing
  int fill(const MeshInput&) const { return 0; }
};
struct Filled {                                  // one that does
  LinearTets fill(const MeshInput&) const { return {}; }
};
"""
SEARCH = """#include "lumo/optimize/optimizer.hpp"
using namespace lumo;
struct Straight {};                              // nothing of a kernel
struct Stubborn {                                // a source that takes no request
  int propose() const { return 0; }
};
"""
SENSE = """#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/devices/replay.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/recording/mcap/mcap_writer.hpp"
using namespace lumo;
using namespace lumo::sense;
struct Watch {                                   // a camera
  std::optional<Frame> next() { return {}; }
  StreamState state() const { return {}; }
};
struct Stalled {};                               // nothing of an actuator
struct Lost {                                    // a localiser that never says where
  void update(const Profile&) {}
};
struct Silent {                                  // a decoder that is never trained
  int predict(const Eigen::VectorXd&) const { return 0; }
};
struct Squeeze {                                 // a codec without a name
  std::vector<std::uint8_t> compress(std::span<const std::uint8_t>) const { return {}; }
};
"""
GROUPS = [
    (
        MECHANICS,
        [
            ("Simulator<int, SDFContact> s;", "Simulator<NeoHookean, SDFContact> s;", "HyperelasticMaterial"),
            (
                "Simulator<Soft, SDFContact> s;",
                "Simulator<NeoHookean, SDFContact, LinearTet> s;",
                "HyperelasticMaterial",
            ),
            ("Simulator<NeoHookean, NeoHookean> s;", "Simulator<NeoHookean, SDFContact> s;", "ContactHandler"),
            ("Simulator<NeoHookean, Inward> s;", "Simulator<NeoHookean, SDFContact> s;", "ContactHandler"),
            (
                "Simulator<NeoHookean, SDFContact, FivePoints> s;",
                "Simulator<NeoHookean, SDFContact, LinearTet> s;",
                "TetElement",
            ),
            (
                "Simulator<NeoHookean, SDFContact, QuadraticTet, double> s;",
                "Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<EigenCholesky>> s;",
                "PressSolver",
            ),
            (
                "Simulator<NeoHookean, SDFContact, LinearTet, Still> s;",
                "Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent> s;",
                "PressSolver",
            ),
            ("QuasiStatic<int> s;", "QuasiStatic<EigenCholesky> s;", "LinearSolver"),
            ("BlockDescent<int> s;", "BlockDescent<Serial> s;", "Executor"),
            ("Scenario<Blunt> s;", "Scenario<Sphere> s;", "Indenter"),
            ("Oriented<Blunt> s;", "Oriented<Sphere> s;", "Indenter"),
            ("VertexPacks<Soft>* s;", "VertexPacks<NeoHookean>* s;", "DilatationalMaterial"),
        ],
    ),
    (
        LIGHT,
        [
            ("Tracer<int> t;", "Tracer<BeerLambert> t;", "TransparentMedium"),
            ("Tracer<Fog> t;", "Tracer<ScatteringMedium> t;", "TransparentMedium"),
            ("Tracer<BeerLambert, Blind> t;", "Tracer<BeerLambert, ExitPower> t;", "ExitReadout"),
            ("Tracer<BeerLambert, ExitPower, int> t;", "Tracer<BeerLambert, ExitPower, Bvh> t;", "Intersector"),
            ("const Emitter e{Lamp{}};", "const Emitter e{RectangleEmitter{}};", "EmitterModel"),
            ("Pipeline<Sieve, int, Tracer<>>* p;", "Pipeline<Filled, int, Tracer<>>* p;", "Mesher"),
        ],
    ),
    (
        SEARCH,
        [
            ("Optimizer<Straight>* o;", "Optimizer<RbfKernel>* o;", "CovarianceKernel"),
            (
                "Optimizer<RbfKernel, LogNehvi, Stubborn>* o;",
                "Optimizer<RbfKernel, LogNehvi, FreshCandidates>* o;",
                "CandidateSource",
            ),
            (
                "Optimizer<RbfKernel, LogNehvi, FreshCandidates, int>* o;",
                "Optimizer<RbfKernel, LogNehvi, FreshCandidates, EachOutput>* o;",
                "Reduction",
            ),
            ("GaussianProcess<Straight>* g;", "GaussianProcess<Matern52Kernel>* g;", "CovarianceKernel"),
        ],
    ),
    (
        SENSE,
        [
            (
                "ForceEstimator<int, RecordedActuator, PeakLocalizer>* e;",
                "ForceEstimator<Watch, RecordedActuator, PeakLocalizer>* e;",
                "Camera",
            ),
            (
                "ForceEstimator<Watch, Stalled, PeakLocalizer>* e;",
                "ForceEstimator<Watch, RecordedActuator, PeakLocalizer>* e;",
                "Actuator",
            ),
            (
                "ForceEstimator<Watch, RecordedActuator, Lost>* e;",
                "ForceEstimator<Watch, RecordedActuator, PeakLocalizer>* e;",
                "LocationEstimator",
            ),
            (
                "ForceEstimator<Watch, RecordedActuator, PeakLocalizer, GreenProfile, Lost>* e;",
                "ForceEstimator<Watch, RecordedActuator, PeakLocalizer, GreenProfile, MomentArm>* e;",
                "ContactJacobian",
            ),
            ("ContactFilter<Lost>* f;", "ContactFilter<MomentArm>* f;", "ContactJacobian"),
            ("McapWriter<Squeeze>* w;", "McapWriter<Uncompressed>* w;", "ChunkCodec"),
        ],
    ),
]


ERROR = re.compile(r"^[^ ]*bad\.cpp:(\d+):\d+: error:")


def compile_lines(command, scratch, name, preamble, lines):
    source = pathlib.Path(scratch) / name
    spaces = "\n".join(f"namespace n{k} {{ {line} }}" for k, line in enumerate(lines))
    source.write_text(preamble + spaces + "\n", encoding="utf-8")
    done = subprocess.run([*command, str(source)], capture_output=True, text=True)
    return done.returncode, done.stderr


def faults_of(command, preamble, all_cases):
    first, faults = preamble.count("\n") + 1, []
    with tempfile.TemporaryDirectory() as scratch:
        code, errors = compile_lines(command, scratch, "sound.cpp", preamble, [good for _, good, _ in all_cases])
        if code != 0:
            return [f"the sound lines do not compile:\n{errors}"]
        for begin in range(0, len(all_cases), 6):  # clang gives up after twenty errors
            cases = all_cases[begin : begin + 6]
            _, errors = compile_lines(command, scratch, "bad.cpp", preamble, [bad for bad, _, _ in cases])
            said, at = {}, None  # line -> its errors with their notes
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


def check(compiler, folders):
    command = [compiler, *FLAGS, "-I", str(folders[0])]
    for folder in folders[1:]:
        command += ["-isystem", folder]
    return [fault for preamble, cases in GROUPS for fault in faults_of(command, preamble, cases)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    arguments = parser.parse_args()
    found = check(arguments.compiler, arguments.include)
    print("\n".join(found) if found else f"{sum(len(cases) for _, cases in GROUPS)} lines are refused by name")
    sys.exit(1 if found else 0)
