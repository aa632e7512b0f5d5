"""Counts the templates that clang instantiates where lumo is used, or the header of a stage included (the programs of
benchmarks/parse_cost), and compares with what was recorded: at most 3 % more.

usage: check_cost.py --compiler clang++ --include DIR… [--record]
Unlike seconds, counts are the same on every machine, but not with every compiler or library: another version of them is
not compared (exit code 77).
The first include folder is lumo's own; the others are taken as system folders.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "parse_cost"))
sys.dont_write_bytecode = True
import measure  # noqa: E402

BASELINE = pathlib.Path(__file__).with_name("cost.json")
LIMIT = 1.03


def tools(compiler, folders):
    """Versions of the compiler, its standard library and Eigen."""
    eigen = ".".join(f"EIGEN_{part}_VERSION" for part in ("WORLD", "MAJOR", "MINOR"))
    versions = f"clang __clang_major__ library _GLIBCXX_RELEASE eigen {eigen}"
    probe = f"#include <vector>\n#include <Eigen/Core>\n{versions}\n"
    system = [word for folder in folders[1:] for word in ("-isystem", folder)]
    done = subprocess.run(
        [compiler, "-std=c++20", "-E", "-P", "-x", "c++", *system, "-"],
        input=probe,
        capture_output=True,
        text=True,
        check=True,
    )
    return re.sub(r"\s*\.\s*", ".", done.stdout.strip().splitlines()[-1])


def compare(counts, recorded):
    """What has grown beyond the limit, one line each."""
    faults = []
    for name, kinds in counts.items():
        for kind, count in kinds.items():
            before = recorded.get(name, {}).get(kind)
            if before is None:
                faults.append(f"{name}: no count of {kind} is recorded")
            elif count > LIMIT * before:
                growth = f"{100 * (count / before - 1):+.1f} %, at most +3 %"
                faults.append(f"{name}: instantiates {count} {kind}, recorded are {before}: {growth}")
    return faults


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    parser.add_argument("--record", action="store_true")
    arguments = parser.parse_args()
    here = tools(arguments.compiler, arguments.include)
    recorded = {} if arguments.record else json.loads(BASELINE.read_text(encoding="utf-8"))
    if not arguments.record and recorded["tools"] != here:
        print(f"not compared: recorded with {recorded['tools']}, here is {here}")
        return 77
    counts = {p.name: measure.instantiations(arguments.compiler, arguments.include, p) for p in measure.programs()}
    if arguments.record:
        BASELINE.write_text(json.dumps({"tools": here, "programs": counts}, indent=1) + "\n", encoding="utf-8")
        return 0
    found = compare(counts, recorded["programs"])
    print(
        "\n".join(found)
        if found
        else "; ".join(f"{name} {kinds['functions']} + {kinds['classes']}" for name, kinds in counts.items())
    )
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
