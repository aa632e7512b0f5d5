"""Makes a project outside the tree, as a user would: the policies of docs/pages/own.md as its own files, lumo
as an installed package. Builds it, runs its small campaign twice (the second run has nothing left to do), and again in
two steps with a kill between them: the same designs and numbers.

usage: check_outside.py --cmake cmake --compiler c++ --prefix DIR --scratch DIR
"""

import argparse
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
EVALUATIONS = 4


def run(*command, **options):
    done = subprocess.run(
        [str(c) for c in command], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options
    )
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}")
    return done.stdout.splitlines()


def main(a):
    project = pathlib.Path(a.scratch)
    shutil.rmtree(project, ignore_errors=True)
    project.mkdir(parents=True)
    policies = [ROOT / "examples/own" / f"{name}.hpp" for name in ("material", "contact", "emitter", "objective")]
    for source in [*(ROOT / "tests/repository/outside").iterdir(), *policies]:
        shutil.copy(source, project)
    run(
        a.cmake,
        "-S",
        project,
        "-B",
        project / "build",
        f"-DCMAKE_PREFIX_PATH={a.prefix}",
        f"-DCMAKE_CXX_COMPILER={a.compiler}",
    )
    cache = (project / "build/CMakeCache.txt").read_text(encoding="utf-8")
    if f"lumo_DIR:PATH={a.prefix}" not in cache:
        sys.exit("another lumo was found than the installed one")
    run(a.cmake, "--build", project / "build")
    program = project / "build/outside"

    whole = run(program, project / "whole.db")
    designs, end = whole[:-1], whole[-1]
    begins = end.startswith(f"observed {EVALUATIONS}, hypervolume ")
    if len(designs) != EVALUATIONS or not begins or float(end.split()[-1]) <= 0.0:
        sys.exit("\n".join(["not the campaign that was asked for:", *whole]))
    for line in designs:  # number, five lengths, two objectives
        even, firm = map(float, line.split()[6:])
        if not (0.0 < even <= 1.0 and firm > 0.0):
            sys.exit(f"objectives are out of range: {line}")
    if run(program, project / "whole.db") != [end]:
        sys.exit("the finished campaign evaluates again")

    cut = subprocess.Popen(["stdbuf", "-oL", program, project / "cut.db"], text=True, stdout=subprocess.PIPE)
    first = cut.stdout.readline().rstrip("\n")
    cut.kill()
    cut.wait()
    rest = run(program, project / "cut.db")
    if first != designs[0] or rest[-1] != end or not set(rest[:-1]) <= set(designs):
        sys.exit("\n".join(["after a kill it is another campaign:", first, *rest, "instead of", *whole]))
    print("\n".join(whole))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("cmake", "compiler", "prefix", "scratch"):
        parser.add_argument("--" + name, required=True)
    main(parser.parse_args())
