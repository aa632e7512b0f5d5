"""Checks the names in all headers by clang-tidy's readability-identifier-naming, with the rules of .clang-tidy.

usage: check_names.py --clang-tidy TOOL --config .clang-tidy --include DIR… [--skip support/x.hpp]…
The first include folder is lumo's own; the others are taken as system folders.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

FAULT = re.compile(r"^(.*?):(\d+):\d+: (?:warning|error): (.*?)(?: \[readability-identifier-naming.*\])?$")


def check(tool, config, folders, skip=()):
    own = pathlib.Path(folders[0]).resolve()
    headers = [h.relative_to(own).as_posix() for h in sorted((own / "lumo").rglob("*.hpp"))]
    headers = [h for h in headers if h[len("lumo/") :] not in skip]
    if not headers:
        return ["no headers found"], 0
    with tempfile.TemporaryDirectory() as scratch:
        source = pathlib.Path(scratch) / "every_header.cpp"
        source.write_text("".join(f'#include "{h}"\n' for h in headers), encoding="utf-8")
        command = [
            tool,
            f"--config-file={config}",
            "--checks=-*,readability-identifier-naming",
            f"--header-filter=^{re.escape(str(own))}/lumo/",
            "--quiet",
            str(source),
            "--",
            "-std=c++20",
            "-I",
            str(own),
        ]
        for folder in folders[1:]:
            command += ["-isystem", folder]
        done = subprocess.run(command, capture_output=True, text=True)
    faults = []
    for line in done.stdout.splitlines():
        match = FAULT.match(line)
        if match:
            faults.append(f"{match[1].removeprefix(str(own) + '/')}:{match[2]}: {match[3]}")
    if done.returncode and not faults:
        faults.append(f"{tool} failed:\n{done.stdout}{done.stderr}")
    return faults, len(headers)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--clang-tidy", required=True)
    parser.add_argument("--config", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    parser.add_argument("--skip", action="append", default=[])
    arguments = parser.parse_args()
    found, total = check(arguments.clang_tidy, arguments.config, arguments.include, arguments.skip)
    print("\n".join(found) if found else f"the names in {total} headers follow the rules")
    sys.exit(1 if found else 0)
