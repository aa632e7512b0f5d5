"""Measures what it costs to share a campaign, and writes results.md beside it and the figures of the page
docs/pages/machines.md. Starts a PostgreSQL server of its own.

usage: measure.py path/to/lumo_campaign [MEDIAN SPREAD PROPOSAL]
The last three are of the simulation: median and spread (of the logarithm) of a contact's time, and a proposal's time,
in seconds.
"""

import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path[:0] = [str(HERE.parent), str(ROOT / "tests" / "cli")]
sys.dont_write_bytecode = True
import pages  # noqa: E402
import postgres_server  # noqa: E402

PAGE = ROOT / "docs" / "pages" / "machines.md"
BEGIN, END = "<!-- measured -->\n", "<!-- end of what was measured -->\n"


def rows(program, *words):
    done = subprocess.run([program, *map(str, words)], check=True, stdout=subprocess.PIPE, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def table(head, lines):
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in [head, ["---"] * len(head), *lines])


def measured(program, median, spread, proposal):
    server = postgres_server.Server()
    try:
        address = f"postgresql://lumo@/postgres?host={server.data}"
        claims = [rows(program, "claims", address, sessions, 5)[0] for sessions in (1, 4, 16, 64)]
        asleep = [rows(program, "sleep", address, 64, pending, 5, 30)[0] for pending in (64, 128)]
    finally:
        server.close()
    pending = rows(program, "pending", 8, 12)
    walls = rows(program, "simulate", median, spread, proposal)
    name, threads = pages.processor()
    last = pending[-1]
    text = f"On {threads} threads of {name}, shared with other work; server, workers and clients on that machine.\n\n"
    text += table(
        ["sessions at once", "claims a second, each claimed and given back", "ms a claim"],
        [[c["sessions"], f"{c['claims_per_s']:.0f}", f"{c['ms_per_claim']:.2f}"] for c in claims],
    )
    text += "\n64 workers that sleep 4 to 6 s for each of 1920 designs, from their start to the end of the last:\n\n" + table(
        ["designs under way", "wall time [s]", "share of the ideal"],
        [[s["pending"], f"{s['wall_s']:.1f}", f"{s['efficiency']:.3f}"] for s in asleep],
    )
    text += (
        "\nAt 40 evaluations in closed form with 8 designs under way the hypervolume is "
        f"{last['mean_share']:.3f} of the sequential one (mean of {last['seeds']} seeds, paired; median {last['median_share']:.3f}, least "
        f"{last['least_share']:.3f}).\n"
    )
    keys = [k for k in walls[0] if k != "workers"]
    text += (
        "\n**Simulated, not run**, from assumed times: 160 evaluations of 28 contacts that are log-normal with a median "
        f"of {median} s and a spread of {spread}; {proposal} s a proposal, one after the other. Wall time in hours; W is "
        "the number of workers. Claims of single contacts are not there yet.\n\n"
    ) + table(
        ["workers", *[k.removesuffix("_h").replace("_", " ").replace("twice", "2 W") for k in keys]],
        [[w["workers"], *[w[k] for k in keys]] for w in walls],
    )
    return text


def main():
    program, *simulated = sys.argv[1:]
    median, spread, proposal = simulated or ("25", "0.5", "2")
    text = measured(program, median, spread, proposal)
    (HERE / "results.md").write_text("# What it costs to share a campaign\n\n" + text, encoding="utf-8")
    pages.replace_part(PAGE, BEGIN, END, text)


if __name__ == "__main__":
    main()
