"""False alarms on clean logs of the virtual lab, and random pairs of faults.

    python benchmarks/sense/field_alarms.py alarms LUMO CACHE [SEEDS]        > table.md
    python benchmarks/sense/field_alarms.py pairs LUMO LOG [TRIALS] [SEED]   > table.md

`alarms` makes a log of each seed (lumo lab force --coarse --seed N --cache CACHE), with its segments and without, and
counts the notes by kind. `pairs` puts two random faults of field_variants.py into one log: each run must end with finite
numbers, or be refused in one line. Needs numpy and opencv-python-headless."""

import collections
import itertools
import json
import math
import pathlib
import random
import re
import subprocess
import sys
import tempfile

import field_variants


def notes_of(program, command, log):
    done = field_variants.run(program, command, log, "--json", "--quiet")
    if done.returncode != 0:
        return [f"refused: {done.stderr.strip()}"]
    return [n.split(": ", 1)[-1] for n in json.loads(done.stdout)["log"]["notes"]]


def kind_of(note):
    """Without numbers, so that one kind of note counts as one."""
    return " ".join(re.sub(r"[-+]?\d[\d.,]*", "#", note).split()[:9])


def wilson(right, every, z=1.96):
    share, squared = right / every, z * z / every
    half = z * math.sqrt(share * (1 - share) / every + squared / (4 * every))
    return 100 * (share + squared / 2 + half) / (1 + squared)


def alarms(program, cache, seeds="50"):
    seeds = int(seeds)
    found = collections.Counter()
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(1, seeds + 1):
            log = pathlib.Path(scratch) / f"log{seed}"
            subprocess.run(
                [program, "lab", "force", "--coarse", "--seed", str(seed), "--cache", cache, "--out", log, "--quiet"],
                check=True,
                capture_output=True,
            )
            for how in ["with segments", "without segments"]:
                if how == "without segments":
                    session = json.loads((log / "session.json").read_text())
                    (log / "session.json").write_text(json.dumps({**session, "segments": []}))
                found.update({(how, kind_of(n)) for n in notes_of(program, "force", log)})
            subprocess.run(["rm", "-r", log], check=True)
            print(f"seed {seed}: {sum(found.values())} notes so far", file=sys.stderr)
    print(f"| log | note | seeds of {seeds} | at most % (95 %) |\n|---|---|---|---|")
    for (how, kind), count in sorted(found.items()):
        print(f"| {how} | {kind} | {count} | {wilson(count, seeds):.1f} |")
    print(f"| both | none of the others | 0 | {wilson(0, seeds):.1f} |")


def is_finite(value):
    if isinstance(value, dict):
        return all(is_finite(v) for v in value.values())
    if isinstance(value, list):
        return all(is_finite(v) for v in value)
    return not isinstance(value, float) or math.isfinite(value)


def drawn_pair(draw, faults, base):
    """Two faults and the log that has both; pairs of which one takes away what the other changes are none."""
    while True:
        a, b = draw.choice(list(itertools.combinations(faults, 2)))
        log = base.copy()
        try:
            a.make(log)
            b.make(log)
        except KeyError:
            continue
        return a, b, log


def pairs(program, source, trials="1000", seed="1"):
    draw = random.Random(int(seed))
    base = field_variants.Log.read(source)
    faults = [v for v in field_variants.VARIANTS if not v.two_joints and not v.pack and v.name != "control"]
    outcomes, wrong = collections.Counter(), []
    with tempfile.TemporaryDirectory() as scratch:
        for trial in range(int(trials)):
            a, b, log = drawn_pair(draw, faults, base)
            folder = pathlib.Path(scratch) / f"trial{trial}"
            log.write(folder)
            options = [o for v in (a, b) if draw.random() < 0.5 for o in v.options]
            done = field_variants.run(program, "force", folder, "--json", "--quiet", *options)
            if done.returncode == 0:
                good = is_finite(json.loads(done.stdout))
                outcomes["finite, with notes" if json.loads(done.stdout)["log"]["notes"] else "finite, no note"] += good
            else:
                good = done.returncode in (2, 4, 5) and len(done.stderr.strip().splitlines()) == 1
                outcomes["refused in one line"] += good
            if not good:
                wrong.append(f"{a.name} + {b.name}: exit {done.returncode}, {done.stderr.strip()[:200]}")
            subprocess.run(["rm", "-r", folder], check=True)
    print("| outcome | pairs |\n|---|---|")
    for name, count in sorted(outcomes.items()):
        print(f"| {name} | {count} |")
    print(f"| neither | {len(wrong)} |")
    print("\n".join(wrong), file=sys.stderr)
    return len(wrong) > 0


if __name__ == "__main__":
    sys.exit({"alarms": alarms, "pairs": pairs}[sys.argv[1]](*sys.argv[2:]))
