"""README and manual as a newcomer reads them: clones the repository and runs, in order and as they stand there, all
commands that both show.

usage: check_newcomer.py --scratch DIR [--from N]
Searches and studies that take hours are stopped once they have found something, or after half a minute where that
takes long, as the manual says may be done at any time. tests/run is not run: it is what runs this. With --from the
clone of an earlier run is kept and the first N − 1 commands are passed over.
"""

import argparse
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/manual.md")
SPACE = (
    '{"variables": [{"name": "a", "lower": 2, "upper": 29, "step": 0.5}], '
    '"objectives": [{"name": "f", "goal": "maximize", "reference": 0}], "evaluations": 4}'
)
ANSWERS = "".join('{"tell": {"id": %d, "y": [%d]}}\n' % (k, k) for k in range(4))
# What takes hours, and the line of progress after which it has shown what it does; none: half a minute.
LONG = {
    "campaign run": r"^lumo: +[2-9]/",
    "study carrier": r"^lumo: +1/",
    "study void": r"^lumo: +1/",
    "study readings": None,
}
INTERRUPTED = 130
LEAST = 24  # commands of both pages
PROMISED = (
    "first",
    "press.svg",
    "out/section.svg",
    "out/report.html",
    "out/evaluation/evaluation.json",
    "ds_flat.csv",
    "report.html",
    "run.jsonl",
    "pressed/session.json",
    "places/locations.csv",
    "forces/forces.csv",
    "pressed.mcap",
)


def commands(page):
    lines = [
        line for block in re.findall(r"```sh\n(.*?)```", page, re.DOTALL) for line in block.splitlines() if line.strip()
    ]
    return [re.split(r"\s+# ", line)[0].strip() for line in lines]


def has_shown(words, log, begun):
    if LONG[words]:
        return re.search(LONG[words], log.read_text(encoding="utf-8"), re.MULTILINE)
    return time.monotonic() > begun + 30.0


def run(command, folder, log):
    """Exit code of one command, and whether it is as it should be."""
    with open(log, "w", encoding="utf-8") as out:
        process = subprocess.Popen(
            command,
            shell=True,
            executable="/bin/bash",
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        if "optimize" in command:
            process.stdin.write(ANSWERS)
        process.stdin.close()
        long = next((words for words in LONG if f"lumo {words} " in command), None)
        begun = time.monotonic()
        while long and process.poll() is None:
            time.sleep(1.0)
            if has_shown(long, log, begun):
                os.killpg(process.pid, signal.SIGTERM)
                break
        code = process.wait()
    return code, (code in (0, INTERRUPTED) if long else code == 0)


def main(scratch, first):
    clone = scratch / "lumo"
    if first == 1:
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    (clone / "space.json").write_text(SPACE, encoding="utf-8")
    shown = [command for page in PAGES for command in commands((clone / page).read_text(encoding="utf-8"))]
    faults = [] if len(shown) >= LEAST else [f"{len(shown)} commands are shown, at least {LEAST} are expected"]
    for number, command in enumerate(shown, 1):
        if number < first or command == "tests/run":
            continue
        begun, log = time.monotonic(), scratch / f"{number:02}.txt"
        code, good = run(command, clone, log)
        print(f"{number:2}  {time.monotonic() - begun:7.1f} s  exit code {code}  {command}", flush=True)
        if not good:
            faults.append(f"{command}: exit code {code}\n{log.read_text(encoding='utf-8')[-2000:]}")
    for promised in PROMISED:
        path = clone / promised
        if not path.is_file() or path.stat().st_size == 0:
            faults.append(f"{promised} is not there, or empty")
    print("\n".join(faults))
    return 1 if faults else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scratch", required=True, type=pathlib.Path)
    parser.add_argument("--from", dest="first", type=int, default=1)
    arguments = parser.parse_args()
    sys.exit(main(arguments.scratch, arguments.first))
