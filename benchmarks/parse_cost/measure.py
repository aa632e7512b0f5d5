"""What it costs to compile five small programs: nothing but Eigen, all of lumo included, one simulator, one tracer, an evaluation.

usage: measure.py --compiler c++ [c++ …] --include DIR… [--runs 3] [--page FILE]
The first include folder is lumo's own; the others are taken as system folders. Prints CPU seconds (the best of the runs, -O0 -c), what they are above
Eigen alone and in its own time, and the peak memory; for clang also how many function and class templates were instantiated. With --page the tables are
put between that page's markers, with the machine's name.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import pages

PROGRAMS = ["eigen", "lumo", "simulator", "tracer", "evaluate"]
FOLDER = pathlib.Path(__file__).parent / "programs"


def command(compiler, folders, name, output):
    system = [word for folder in folders[1:] for word in ("-isystem", folder)]
    return [compiler, "-std=c++20", "-O0", "-c", "-I", folders[0], *system, "-o", str(output), str(FOLDER / f"{name}.cpp")]


def is_clang(compiler):
    return "clang" in version(compiler)


def version(compiler):
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def cost(compiler, folders, name):
    """CPU seconds and peak memory [MB] of one compilation, the compiler's children included."""
    with tempfile.TemporaryDirectory() as scratch:
        process = subprocess.Popen(command(compiler, folders, name, pathlib.Path(scratch) / "x.o"))
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{name}.cpp does not compile")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def instantiations(compiler, folders, name):
    """Function and class templates that clang instantiates for a program. Granularity 0: otherwise clang reports the slow ones only."""
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run([*command(compiler, folders, name, pathlib.Path(scratch) / "x.o"), "-ftime-trace", "-ftime-trace-granularity=0"],
                              capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"{name}.cpp does not compile:\n{done.stderr}")
        events = json.loads((pathlib.Path(scratch) / "x.json").read_text(encoding="utf-8"))["traceEvents"]
    kinds = [event["name"] for event in events]
    return {"functions": kinds.count("InstantiateFunction"), "classes": kinds.count("InstantiateClass")}


def table(compiler, folders, runs):
    counted = is_clang(compiler)
    yield f"{version(compiler)}:\n"
    yield "| program | CPU [s] | above Eigen alone [s] | in Eigen's | memory [MB] |" + (" functions | classes |" if counted else "")
    yield "|---|---|---|---|---|" + ("---|---|" if counted else "")
    eigen = None
    for name in PROGRAMS:
        costs = [cost(compiler, folders, name) for _ in range(runs)]
        seconds, memory = min(costs)[0], max(m for _, m in costs)
        eigen = eigen or seconds
        line = f"| {name} | {seconds:.2f} | {seconds - eigen:.2f} | {seconds / eigen:.1f} | {memory:.0f} |"
        if counted:
            count = instantiations(compiler, folders, name)
            line += f" {count['functions']} | {count['classes']} |"
        yield line


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", nargs="+", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--page", type=pathlib.Path)
    arguments = parser.parse_args()
    lines = []
    for compiler in arguments.compiler:
        for line in table(compiler, arguments.include, arguments.runs):
            print(line, flush=True)
            lines.append(line)
        lines.append("")
    if arguments.page:
        begin, end = "<!-- measured: made by benchmarks/parse_cost/measure.py -->\n", "<!-- measured: end -->\n"
        name, threads = pages.processor()
        pages.replace_part(arguments.page, begin, end, "\n" + "\n".join([*lines, f"{name}, {threads} threads.", "", ""]))


if __name__ == "__main__":
    sys.exit(main())
