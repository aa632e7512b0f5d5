#!/usr/bin/env python3
"""Random damage to transcripts of `lumo optimize`: flipped bits, cuts, and lines that changed places.

usage: benchmarks/optimize/damage.py PROGRAM [DAMAGES] [SEED]

Each damaged transcript is gone on with. It is refused by its number of line and stays as it is; or, where all that was
cut off is its end, the rest is asked again and the result is the same to the bit. All else is silent damage.
"""

import pathlib
import random
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import siblings

SPACE = dict(siblings.BRANIN, sobol=6, evaluations=16, source="paper")
BAD_FILE = 5


def damaged(good, rng, kind):
    lines = good.splitlines(keepends=True)
    if kind == "bit":
        data = bytearray(good)
        data[rng.randrange(len(good))] ^= 1 << rng.randrange(8)
        return bytes(data)
    if kind == "cut":
        begin = rng.randrange(len(good))
        return good[:begin] + good[begin + rng.randrange(1, 300) :]
    a, b = rng.sample(range(len(lines)), 2)
    lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def outcome(lumo, folder, file, good, data, whole):
    file.write_bytes(data)
    s = siblings.Search(lumo, folder, SPACE, siblings.answering(siblings.branin), "--transcript", file)
    if s.code == BAD_FILE and s.said.count("\n") == 0 and not s.x and file.read_bytes() == data:
        return "refused"
    again = s.code == 0 and s.last == whole.last and s.x == whole.x[len(whole.x) - len(s.x) :]
    return "asked again" if again and good.startswith(data.rpartition(b"\n")[0]) else "SILENT"


def main(lumo, count=1000, seed=1):
    rng, begun = random.Random(int(seed)), time.monotonic()
    tally = {}
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "run.jsonl"
        whole = siblings.Search(lumo, folder, SPACE, siblings.answering(siblings.branin), "--transcript", file)
        good = file.read_bytes()
        for k in range(int(count)):
            kind = ("bit", "cut", "swap")[k % 3]
            data = damaged(good, rng, kind)
            end = "unchanged" if data == good else outcome(lumo, folder, file, good, data, whole)
            tally[kind, end] = tally.get((kind, end), 0) + 1
            if end == "SILENT":
                pathlib.Path(f"silent-{k}.jsonl").write_bytes(data)
    for (kind, end), n in sorted(tally.items()):
        print(f"{kind:5} {end:12} {n}")
    silent = sum(n for (_, end), n in tally.items() if end == "SILENT")
    print(f"{count} damages, {silent} silent, {time.monotonic() - begun:.0f} s")
    return 1 if silent else 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:4]))
