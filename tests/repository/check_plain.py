"""Builds a two-file program with nothing but a compiler and -I, and runs it.

usage: check_plain.py --compiler c++ --include DIR…   (lumo's own first, then Eigen's)
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

UMBRELLAS = ["lumo", "sense", "lab", "fabrication"]
EVERY_HEADER = "#pragma once\n" + "".join(f'#include "lumo/{name}.hpp"\n' for name in UMBRELLAS)
EVERY_HEADER += "inline auto executor() { return lumo::Serial{}; }\n"

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    arguments = parser.parse_args()
    sources = pathlib.Path(__file__).parent / "consumer"
    with tempfile.TemporaryDirectory() as scratch:
        (pathlib.Path(scratch) / "every_header.hpp").write_text(EVERY_HEADER, encoding="utf-8")
        program = f"{scratch}/consumer"
        folders = [word for folder in [*arguments.include, scratch] for word in ("-I", folder)]
        command = [
            arguments.compiler,
            "-std=c++20",
            *folders,
            str(sources / "one.cpp"),
            str(sources / "two.cpp"),
            "-o",
            program,
        ]
        print(" ".join(command), flush=True)
        sys.exit(subprocess.run(command).returncode or subprocess.run([program]).returncode)
