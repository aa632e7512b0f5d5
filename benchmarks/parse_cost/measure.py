"""What it costs to compile with lumo: the header of each stage included, and programs that use it, beside Eigen alone.

usage: measure.py --compiler c++ [c++ …] --include DIR… [--runs 3] [--page FILE]
The first include folder is lumo's own; the others are taken as system folders. Prints CPU seconds (-O0 -c) and what
they are above Eigen, each run paired with one of Eigen alone just before it: the best of the runs. Also the peak
memory, the limit, and for clang how many function and class templates were instantiated. With --page the tables are
put between that page's markers, with the machine's name. The exit code is 1 if one of the first compiler's programs is
beyond its limit.
"""

import argparse
import dataclasses
import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import pages

# Headers that a program includes and does not use.
INCLUDED = {
    "section": "lumo/morphology/section.hpp",
    "mesher": "lumo/mesh/swept_mesher.hpp",
    "simulator": "lumo/mechanics/simulator.hpp",
    "tracer": "lumo/optics/tracer.hpp",
    "contact_progression": "lumo/objective/contact_progression.hpp",
    "sampler": "lumo/optimize/design_sampler.hpp",
}
# Programs of the folder `programs`, and their limits [CPU s].
USED = {"simulator": 8.0, "observe": 8.0, "evaluate": 14.0}
ABOVE_EIGEN = 2.0  # limit of each included header [CPU s]
FOLDER = pathlib.Path(__file__).parent / "programs"


@dataclasses.dataclass
class Program:
    name: str
    text: str
    limit: float = 0.0  # [CPU s]; 0: none
    above_eigen: bool = False  # what the limit is of


def programs():
    """Eigen alone first."""
    yield Program("eigen", (FOLDER / "eigen.cpp").read_text(encoding="utf-8"))
    for name, header in INCLUDED.items():
        yield Program(f"{name} included", f'#include "{header}"\n\nint main() {{}}\n', ABOVE_EIGEN, True)
    for name, limit in USED.items():
        yield Program(f"{name} used", (FOLDER / f"{name}.cpp").read_text(encoding="utf-8"), limit)


def command(compiler, folders, source):
    system = [word for folder in folders[1:] for word in ("-isystem", folder)]
    return [
        compiler,
        "-std=c++20",
        "-O0",
        "-c",
        "-I",
        folders[0],
        *system,
        "-o",
        str(source.with_suffix(".o")),
        str(source),
    ]


def is_clang(compiler):
    return "clang" in version(compiler)


def version(compiler):
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def cost(compiler, folders, program):
    """CPU seconds and peak memory [MB] of one compilation, the compiler's children included."""
    with tempfile.TemporaryDirectory() as scratch:
        source = pathlib.Path(scratch) / "x.cpp"
        source.write_text(program.text, encoding="utf-8")
        process = subprocess.Popen(command(compiler, folders, source))
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{program.name} does not compile")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def instantiations(compiler, folders, program):
    """Function and class templates that clang instantiates. Granularity 0: it reports those too that take no time."""
    with tempfile.TemporaryDirectory() as scratch:
        source = pathlib.Path(scratch) / "x.cpp"
        source.write_text(program.text, encoding="utf-8")
        words = [*command(compiler, folders, source), "-ftime-trace", "-ftime-trace-granularity=0"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"{program.name} does not compile:\n{done.stderr}")
        events = json.loads(source.with_suffix(".json").read_text(encoding="utf-8"))["traceEvents"]
    kinds = [event["name"] for event in events]
    return {"functions": kinds.count("InstantiateFunction"), "classes": kinds.count("InstantiateClass")}


def paired(compiler, folders, program, eigen, runs):
    """Least CPU seconds, least seconds above Eigen's of the same run, and most memory [MB]."""
    seconds, above, memory = [], [], []
    for _ in range(runs):
        alone, _ = cost(compiler, folders, eigen)
        spent, used = cost(compiler, folders, program)
        seconds.append(spent)
        above.append(spent - alone)
        memory.append(used)
    return min(seconds), min(above), max(memory)


def measured(compiler, folders, runs):
    """Lines of the table, and the names of programs beyond their limits."""
    counted = is_clang(compiler)
    lines = [
        f"{version(compiler)}:\n",
        "| program | CPU [s] | above Eigen [s] | limit [s] | memory [MB] |"
        + (" functions | classes |" if counted else ""),
        "|---|---|---|---|---|" + ("---|---|" if counted else ""),
    ]
    beyond = []
    eigen, *others = programs()
    for program in [eigen, *others]:
        seconds, above, memory = paired(compiler, folders, program, eigen, runs)
        if program is eigen:
            above = 0.0
        if program.limit and (above if program.above_eigen else seconds) > program.limit:
            beyond.append(program.name)
        limit = f"{'Eigen + ' if program.above_eigen else ''}{program.limit:g}" if program.limit else ""
        line = f"| {program.name} | {seconds:.2f} | {above:.2f} | {limit} | {memory:.0f} |"
        if counted:
            count = instantiations(compiler, folders, program)
            line += f" {count['functions']} | {count['classes']} |"
        print(line, file=sys.stderr, flush=True)
        lines.append(line)
    return lines, beyond


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", nargs="+", required=True)
    parser.add_argument("--include", nargs="+", required=True)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--page", type=pathlib.Path)
    arguments = parser.parse_args()
    lines, beyond = [], []
    for compiler in arguments.compiler:  # the limits are the first one's
        table, slow = measured(compiler, arguments.include, arguments.runs)
        beyond = beyond if lines else slow
        lines += [*table, ""]
    print("\n".join(lines))
    if arguments.page:
        begin, end = "<!-- measured: made by benchmarks/parse_cost/measure.py -->\n", "<!-- measured: end -->\n"
        name, threads = pages.processor()
        pages.replace_part(
            arguments.page, begin, end, "\n" + "\n".join([*lines, f"{name}, {threads} threads.", "", ""])
        )
    print("\n".join(f"{name} is beyond its limit" for name in beyond), end="\n" if beyond else "")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
