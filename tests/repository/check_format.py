"""Checks that all C++ files are as clang-format writes them, by .clang-format.

usage: check_format.py --clang-format TOOL ROOT
Another version writes other lines: where the tool is missing or not of version 14, nothing is checked (exit code 77).
"""

import argparse
import collections
import pathlib
import re
import shutil
import subprocess
import sys

FOLDERS = ["include", "examples", "tests", "benchmarks"]
VERSION = 14
FAULT = re.compile(r"^(.*?):(\d+):\d+: error: ")


def version(tool):
    """Major version of clang-format, 0 where there is none."""
    if not shutil.which(tool):
        return 0
    said = re.search(r"version (\d+)", subprocess.run([tool, "--version"], capture_output=True, text=True).stdout)
    return int(said[1]) if said else 0


def check(tool, root):
    """One line for each file that would be written otherwise, with its first place."""
    files = [p for folder in FOLDERS for p in sorted((root / folder).rglob("*")) if p.suffix in (".hpp", ".cpp")]
    if not files:
        return [f"{root}: no C++ files found"]
    done = subprocess.run(
        [tool, "--dry-run", "-Werror", "--style=file", *map(str, files)], capture_output=True, text=True
    )
    first, places = {}, collections.Counter()
    for match in filter(None, map(FAULT.match, done.stderr.splitlines())):
        first.setdefault(match[1], match[2])
        places[match[1]] += 1
    faults = [
        f"{pathlib.Path(f).relative_to(root)}:{line}: not as clang-format writes it ({places[f]} places, 0)"
        for f, line in first.items()
    ]
    return faults or ([f"{tool} failed:\n{done.stderr}"] if done.returncode else [])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--clang-format", default="clang-format")
    parser.add_argument("root", type=lambda p: pathlib.Path(p).resolve())
    arguments = parser.parse_args()
    found = version(arguments.clang_format)
    if found != VERSION:
        print(
            f"not checked: needs clang-format {VERSION}, "
            + (f"{arguments.clang_format} is version {found}" if found else "which is missing (package clang-format)")
        )
        return 77
    faults = check(arguments.clang_format, arguments.root)
    print("\n".join(faults) if faults else "all files are as clang-format writes them")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
