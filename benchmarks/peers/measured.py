"""What the scripts of `benchmarks/peers/run` share: the machine, and raw figures as small JSON files beside the
scripts."""

import datetime
import importlib.metadata
import json
import pathlib
import platform
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
BUILT = HERE.parents[1] / "build/release"
sys.path.insert(0, str(HERE.parent))
import pages


def machine():
    """Processor, its threads, compiler of lumo's halves, and Python."""
    processor, threads = pages.processor()
    cache = (BUILT / "CMakeCache.txt").read_text(encoding="utf-8")
    compiler = re.search(r"^CMAKE_CXX_COMPILER:[A-Z]+=(.+)$", cache, re.M)[1]
    first = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    return {
        "processor": processor,
        "threads": threads,
        "compiler": f"{pathlib.Path(compiler).name} {re.search(r'[0-9]+[.][0-9.]+', first)[0]}, Release",
        "python": platform.python_version(),
    }


def versions(*packages):
    return {p: importlib.metadata.version(p) for p in packages}


def keep(name, result, packages):
    """Writes NAME.json beside the scripts, whole or not at all."""
    result = {
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "versions": versions(*packages),
        **result,
    }
    draft = HERE / f"{name}.json.part"
    draft.write_text(json.dumps(result, indent=1, default=float) + "\n", encoding="utf-8")
    draft.replace(HERE / f"{name}.json")


class Half:
    """lumo's half of a comparison, which answers lines with lines; one thread."""

    def __init__(self, program, *arguments):
        self.process = subprocess.Popen(
            [BUILT / "benchmarks" / program, *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        if self.process.stdout.readline().strip() != "ready":
            raise RuntimeError(f"{program} did not start")

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"no answer to '{line}'")
        return answer

    def close(self):
        self.process.stdin.close()
        if self.process.wait() != 0:
            raise RuntimeError(f"lumo's half ended with {self.process.returncode}")
