"""The README's first program: it is the example's text, at most 18 lines; its command compiles it, and it prints
equilibria and draws a picture.

usage: check_first.py --compiler c++ --eigen DIR
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

ROOT = pathlib.Path(__file__).resolve().parents[2]


def main(compiler, eigen, scratch):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = re.search(r"```cpp\n(.*?)```", readme, re.DOTALL)[1]
    if shown != (ROOT / "examples/00_first.cpp").read_text(encoding="utf-8"):
        return "the README's first program is not examples/00_first.cpp"
    if shown.count("\n") > 18:
        return f"the first program has {shown.count(chr(10))} lines, at most 18"
    command = re.search(r"^(g\+\+ .*00_first\.cpp.*) && (\S+)", readme, re.MULTILINE)
    words = command[1].replace("g++", compiler, 1).replace("/usr/include/eigen3", eigen).split()
    words[words.index("-o") + 1] = f"{scratch}/first"
    if subprocess.run(words, cwd=ROOT).returncode != 0:
        return "the README's command does not compile it"
    said = subprocess.run([f"{scratch}/first"], cwd=scratch, capture_output=True, text=True, check=True).stdout
    rows = re.findall(r"^(\S+) N at (\S+) mm, converged$", said, re.MULTILINE)
    if [round(float(force)) for force, _ in rows] != [1, 2, 5, 10, 15] or len(said.splitlines()) != 5:
        return f"it says:\n{said}"
    shown_output = re.search(r"```\n((?:\S+ N at .*\n)+)```", readme)[1]
    if shown_output != said:
        return f"it says:\n{said}the README:\n{shown_output}"
    xml.etree.ElementTree.parse(f"{scratch}/press.svg")
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--eigen", required=True)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(main(given.compiler, given.eigen, folder))
