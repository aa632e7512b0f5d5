"""Compiles every header of the library alone and twice over: it must include what it uses and guard itself.

usage: check_headers.py --compiler c++ --include DIR… [--cache FILE] [--skip support/x.hpp]…
The first include folder is lumo's own; the others are taken as system folders. Results are kept in the cache file by
the content of a header and of all that it includes, so that only what has changed is compiled again.
"""

import argparse
import concurrent.futures
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

FLAGS = ["-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Wshadow", "-Wpedantic", "-Werror"]
INCLUDE = re.compile(r'^\s*#\s*include\s*"(lumo/[^"]+)"', re.MULTILINE)


def closure(folder, name, seen):
    """Adds the text of a header and of all lumo headers below it."""
    if name in seen or not (folder / name).is_file():
        return
    seen[name] = (folder / name).read_text(encoding="utf-8")
    for inner in INCLUDE.findall(seen[name]):
        closure(folder, inner, seen)


def check(compiler, folders, cache_file=None, skip=()):
    own = pathlib.Path(folders[0])
    command = [compiler, *FLAGS, "-I", str(own)]
    for folder in folders[1:]:
        command += ["-isystem", folder]
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
    try:
        passed = set(json.loads(pathlib.Path(cache_file).read_text()))
    except (OSError, TypeError, ValueError):
        passed = set()
    headers = [h.relative_to(own).as_posix() for h in sorted((own / "lumo").rglob("*.hpp"))]
    headers = [h for h in headers if h[len("lumo/") :] not in skip]
    if not headers:
        return ["no headers found"], 0

    keys, todo = {}, []
    for header in headers:
        texts = {}
        closure(own, header, texts)
        state = json.dumps([command, version, header, sorted(texts.items())])
        keys[header] = hashlib.sha256(state.encode()).hexdigest()
        if keys[header] not in passed:
            todo.append(header)

    with tempfile.TemporaryDirectory() as scratch:

        def compile_one(header):
            source = pathlib.Path(scratch) / (header.replace("/", "_") + ".cpp")
            source.write_text(f'#include "{header}"\n#include "{header}"\n', encoding="utf-8")
            done = subprocess.run([*command, str(source)], capture_output=True, text=True)
            return header, done.returncode, done.stderr

        faults, good = [], {keys[h] for h in headers if h not in todo}
        with concurrent.futures.ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            for header, code, errors in pool.map(compile_one, todo):
                if code == 0:
                    good.add(keys[header])
                else:
                    faults.append(f"{header} does not compile alone:\n{errors}")
    if cache_file:
        temporary = pathlib.Path(f"{cache_file}.{os.getpid()}")
        temporary.write_text(json.dumps(sorted(good)))
        temporary.replace(cache_file)
    return faults, len(headers)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    parser.add_argument("--cache")
    parser.add_argument("--skip", action="append", default=[])
    arguments = parser.parse_args()
    found, total = check(arguments.compiler, arguments.include, arguments.cache, arguments.skip)
    print("\n".join(found) if found else f"{total} headers compile alone")
    sys.exit(1 if found else 0)
