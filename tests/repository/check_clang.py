"""Lets clang read every source that a build compiles, with the build's own options and warnings as errors.

usage: check_clang.py --compiler clang++ --commands compile_commands.json --root FOLDER [--skip NAME…] [--jobs N]
--skip leaves out what lies in a folder of that name, in the sources or the build below them.
"""

import argparse
import concurrent.futures
import json
import pathlib
import shlex
import subprocess
import sys


def command_of(compiler, entry):
    """The entry's command for clang: parsed and checked, nothing written."""
    words = shlex.split(entry["command"])[1:]
    out = [compiler, "-fsyntax-only", "-Werror", "-Wno-unknown-warning-option"]
    skip = False
    for word in words:
        if skip:
            skip = False
        elif word in ("-o", "-MF", "-MT"):
            skip = True
        elif word not in ("-MD", "-c") and not word.startswith("-Wl,"):
            out.append(word)
    if "/Unity/" in entry["file"]:
        out.append("-Wno-shadow")  # names of one test source may hide those of another that is compiled with it
    return out


def complaints(compiler, entry):
    done = subprocess.run(command_of(compiler, entry), cwd=entry["directory"], capture_output=True, text=True)
    return "" if done.returncode == 0 else f"{entry['file']}:\n{done.stdout}{done.stderr}"


def below(roots, path):
    """Names on the way to a file from the first of the folders that it lies in."""
    return next((path.relative_to(root).parts for root in roots if path.is_relative_to(root)), path.parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--commands", required=True)
    parser.add_argument("--root", type=pathlib.Path, required=True)
    parser.add_argument("--skip", nargs="*", default=[])
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    entries = json.loads(pathlib.Path(arguments.commands).read_text(encoding="utf-8"))
    roots = [pathlib.Path(arguments.commands).parent, arguments.root]
    entries = [e for e in entries if not set(arguments.skip) & set(below(roots, pathlib.Path(e["file"])))]
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        faults = [text for text in pool.map(lambda e: complaints(arguments.compiler, e), entries) if text]
    print("\n".join(faults) if faults else f"clang has nothing to say about {len(entries)} sources")
    sys.exit(1 if faults or not entries else 0)
