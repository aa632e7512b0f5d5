#!/usr/bin/env python3
"""Puts docs/pages/benchmarks.md together from the figures beside this script: newton.json, mitsuba.json, botorch.json,
scikit_fem.json.

usage: benchmarks/peers/page.py
"""

import json
import re
import statistics
import textwrap

import measured

WIDTH = 120  # of the page's prose


def read(name):
    path = measured.HERE / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def table(header, rows):
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows])


def wrapped(text):
    """The page with its prose in lines of at most WIDTH; tables, headings, code and links stay as they are."""

    def fill(block):
        kept = re.sub(r"`[^`]+`|\[[^]]*\]\([^)]*\)", lambda span: span[0].replace(" ", "\0").replace("\n", "\0"), block)
        return textwrap.fill(kept, WIDTH, break_long_words=False, break_on_hyphens=False).replace("\0", " ")

    return "\n\n".join(block if block.startswith(("|", "#")) else fill(block) for block in text.split("\n\n"))


def number(value, digits=3):
    """With so many significant digits, never as a power of ten."""
    if value == 0:
        return "0"
    text = f"{value:.{digits}g}"
    if abs(value) >= 10 ** (digits - 1):
        return f"{float(text):.0f}"
    return text if "e" not in text else f"{value:.6f}".rstrip("0")


def percent(share, digits=2):
    return f"{100 * share:+.{digits}f} %"


def machine(part, result):
    m = result["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return (
        f"{result['date']}; {m['processor']}, {m['threads']} threads of a shared machine; lumo by {m['compiler']}; "
        f"{packages}; Python {m['python']}. `benchmarks/peers/run {part}`" + result.get("note", "")
    )


def newton(r):
    fast = min((row for row in r["lumo"] if abs(row["error"]) <= 0.01), key=lambda row: row["seconds"])
    rows = []
    for row in r["lumo"]:
        rows.append(
            [
                f"lumo, quadratic, {row['finest_mm']:g} mm at the contact, {row['contact_mm']:g} mm beside it",
                str(row["nodes"]),
                f"{row['depth_mm']:.3f}",
                percent(row["error"]),
                number(row["seconds"]),
                number(row["seconds"] / fast["seconds"]),
            ]
        )
    for row in r["newton"]:
        seconds = number(row["settled_seconds"]) if row["settled"] else f"> {number(row['settled_seconds'])}"
        rows.append(
            [
                f"Newton, linear, {row['edge_mm']:g} mm",
                str(row["nodes"]),
                f"{row['depth_mm']:.3f}",
                percent(row["error"]),
                seconds,
                number(row["settled_seconds"] / fast["seconds"]),
            ]
        )
    text = f"""## Newton: depth under a load

The baseline finger is pressed by a sphere of 10 mm with {r['load_N']:g} N. The reference depth is {r['reference_mm']:g}
± {r['reference_uncertainty_mm']:g} mm, extrapolated from Taylor–Hood elements
([reference](../../benchmarks/reference/results.md)). lumo is quasi-static, with quadratic tetrahedra, the locking cure
and CHOLMOD; the first row is the default of `lumo press`. lumo uses the contact's symmetry; Newton's solver does not.
Newton is SolverVBD on linear tetrahedra, frictionless, with {r['sweeps']} sweeps a step of {r['time_step_s']:g} s,
{r['stiffness_N_per_m']:g} N/m of contact a vertex, steps replayed from a captured graph. Its sphere goes at 5 mm/s to
the depth of that mesh's equilibrium and is held there. Its time is that up to the step from which the force stays
within 1 % for {r['stay_s']:g} s. Ratios are to the fastest of lumo's rows.

{table(['', 'nodes', 'depth, mm', 'off the reference', 'CPU s', 'ratio'], rows)}

"""
    e = r.get("extrapolated")
    if e:
        text += (
            f"No mesh here brings Newton to 1 %: linear tetrahedra lock at ν = 0.495. **Extrapolated, not run**: "
            f"errors fall with edge^{e['error_order']:.2f} over these meshes, which would put 1 % at an edge of "
            f"about {number(e['edge_mm'], 1)} mm. With as many steps as on the finest mesh here, each more "
            f"expensive only by its vertices, that is {e['least_seconds']:.0e} CPU s at least; the measured "
            f"times grow faster, with edge^{e['time_order']:.1f}. Three meshes so far from 1 % show only that it is "
            f"out of reach.\n\n"
        )
    soft = ", ".join(
        f"{row['soft_depth_mm']:.3f} mm ({percent(row['soft_depth_mm'] / r['reference_mm'] - 1, 0)}) "
        f"at {row['edge_mm']:g} mm"
        for row in r["newton"]
    )
    text += (
        f"A softer contact hides the error and does not cure it. With {r['soft_N_per_m']:g} N/m a vertex the same "
        f"meshes have their equilibrium at {soft}: overlap makes up for locking.\n\n"
    )
    rows = []
    for row in r["newton"]:
        settled = number(row["settled_seconds"]) if row["settled"] else f"not in {number(row['settled_seconds'])}"
        off = {key: row[f"{key}_N"] / r["load_N"] - 1 for key in ("arrived", "least", "largest", "last")}
        rows.append(
            [
                f"{row['edge_mm']:g} mm",
                str(row["nodes"]),
                f"{number(row['static_seconds'])} ({row['factors']} factors)",
                settled,
                str(row["settled_step"]) if row["settled"] else "–",
                number(row["settled_seconds"] / row["static_seconds"]),
                f"{percent(off['arrived'], 1)}, {number(row['arrived_seconds'])} s",
                f"{percent(off['least'], 1)} … {percent(off['largest'], 1)}",
                percent(off["last"]),
            ]
        )
    header = [
        "edge",
        "nodes",
        "lumo, CPU s",
        "Newton, CPU s",
        "steps",
        "ratio",
        "Newton when the depth is reached",
        "force during the hold",
        "at its end",
    ]
    return text + f"""### The same equilibrium

Both solve the same linear mesh, energy and contact, at the depth of its equilibrium under {r['load_N']:g} N: lumo's
quasi-static solver to a residual of 1e-7 of the load (whole mesh, no symmetry), Newton until its force stays within 1 %
of that.

{table(header, rows)}

{machine('newton', r)}

"""


def mitsuba(r):
    parts = []
    for c in r["cases"]:
        peer, rows = c["mitsuba"], []
        rows.append(
            [
                f"Mitsuba, {c['paths']} paths",
                number(peer["seconds"]),
                f"{100 * peer['error']:.2f} %",
                number(peer["seconds"] * (peer["error"] / 0.01) ** 2),
                "1",
            ]
        )
        for w in c["lumo"]:
            name = {"gathered": "lumo", "forward": "lumo, forward paths only"}[w["way"]]
            name += ", default rays" if w["factor"] == 1 else f", {w['factor']:g} of the default rays"
            name += ", a quarter by symmetry" if w["symmetry"] else ""
            rows.append([name, number(w["seconds"]), f"{100 * w['error']:.2f} %", "–", number(w["efficiency_ratio"])])
        header = ["", "CPU s", "error", "CPU s to 1 %", "error² × time: Mitsuba / this"]
        parts.append(f"**{c['material']}** ({c['triangles']} triangles)\n\n{table(header, rows)}\n")
    rows = [
        [
            c["material"],
            {"gathered": "default", "forward": "forward only"}[w["way"]],
            f"{100 * w['differs']:.2f} %",
            f"{100 * w['expected_to_differ']:.2f} %",
            f"{w['largest_z']:.1f}",
            f"{w['chi2_per_bin']:.2f}",
        ]
        for c in r["cases"]
        for w in c["lumo"]
        if w["factor"] == 1 and not w["symmetry"]
    ]
    first = r["cases"][0]
    return f"""## Mitsuba 3: light, error and time

The task is the response of the unloaded baseline finger, power through eleven bins along its sides. No integrator of
Mitsuba's computes it, so the peer is a loop in Dr.Jit (variant `{r['variant']}`) as a user would write it: forward from
the LEDs, what passes the clear surface is booked at once and what is reflected goes on, Lambertian carrier, roulette
below 0.2, independent numbers. It has lumo's triangles and normals. lumo uses Embree and gathers what leaves through
the bins backwards from them; "forward" does not. Errors are those of one run, from {r['seeds']} seeds of lumo's and
{first['launches']} of Mitsuba's, run in turns: root of the summed variance over the bins, over the norm of the
response. lumo's time contains all that a new state needs, its tree included; Mitsuba's is that of the kernel only
({number(first['first_launch_seconds'], 2)} s more at first use).

First, do they agree? The table gives the difference by norm over the bins, beside the difference expected from the
errors of both; the largest difference of a bin in standard errors; and χ² per bin, which exceeds 1.79 by chance in one
case of twenty:

{table(['silicone', 'lumo', 'differ by', 'expected', 'largest, s.e.', 'χ² per bin'], rows)}

Second, what does an error cost?

{chr(10).join(parts)}
The last column is how many times longer Mitsuba takes to the same error, if its own falls with the root of its paths.
On this convex pad nothing branches and no light comes back in, which favours a forward loop. A quarter by symmetry
works for symmetric states only. Changes under a contact, which decide designs, are in
[the error of light](../../benchmarks/optical_error/results.md).

{machine('mitsuba', r)}

"""


def botorch(r):
    peer = r["shares"]["botorch"]
    names = {"botorch": "BoTorch", "paper": "lumo, as the paper (`paper`)", "default": "lumo, `default`"}
    rows = [
        [
            names[m],
            ", ".join(f"{s:.3f}" for s in shares),
            f"{statistics.median(shares):.3f}",
            f"{statistics.median(a - b for a, b in zip(shares, peer)):+.3f}",
            number(1e3 * r["seconds"][m]),
            number(r["seconds"]["botorch"] / r["seconds"][m]),
        ]
        for m, shares in r["shares"].items()
    ]
    return f"""## BoTorch: the search

The table compares "{r['problem']}" after {r['evaluations']} evaluations, {r['starts']} of them the same starts, with
{len(peer)} seeds: the share of the true front's hypervolume. BoTorch is SingleTaskGP and qLogNEHVI with their defaults
over {r['pool']} fresh candidates. It stands for Ax, too, which proposes by the same acquisition and takes longer.
`paper` is the same method in lumo; `default` also tries neighbours of the front. So few seeds measure times, not
shares: the whole study with ten seeds and seven problems is
[the optimiser beside BoTorch](../../benchmarks/optimize/results.md).

{table(['', 'shares', 'median', 'median difference', 'CPU ms a proposal', 'BoTorch / this'], rows)}

{machine('botorch', r)}

"""


def scikit_fem(r):
    a, s = r["assembly_seconds"], r["solution_seconds"]
    kinds = [
        ("residual", "scikit-fem forces", "lumo forces"),
        ("tangent, form as one writes it down", "scikit-fem tangent", "lumo tangent"),
        ("tangent, form that keeps what 30 test functions share", "scikit-fem sparing tangent", "lumo tangent"),
    ]
    rows = [[name, number(1e3 * a[own]), number(1e3 * a[peer]), number(a[peer] / a[own])] for name, peer, own in kinds]
    best = s["lumo, CHOLMOD"]
    solving = [
        [
            name,
            number(seconds),
            number(seconds / best),
            f"{r['step_differs'][name]:.0e}" if r["step_differs"][name] else "–",
        ]
        for name, seconds in s.items()
    ]
    slower = s["lumo, Eigen's Cholesky"] / min(seconds for name, seconds in s.items() if name.startswith("SuperLU"))
    return f"""## scikit-fem: elements and linear systems

The task is a compressible Neo-Hookean solid with quadratic tetrahedra with curved faces, four quadrature points and
plain displacements: {r['elements']} elements, {r['nodes']} nodes, {r['equations']} free components, in a bent state.
The largest difference is {r['differs']['forces']:.0e} of the largest nodal force, and {r['differs']['tangent']:.0e} of
the tangent's largest entry. Both assemble into a sparse matrix; lumo assembles the lower triangle of a known pattern.
With the locking cure, which lumo's presses have, its residual takes {number(1e3 * a['lumo cured forces'])} ms and its
tangent {number(1e3 * a['lumo cured tangent'])} ms.

{table(['assembly', 'lumo, CPU ms', 'scikit-fem, CPU ms', 'ratio'], rows)}

One linear step with that tangent consists of analysis, factor and solution:

{table(['', 'CPU s', 'ratio to CHOLMOD', 'step differs by'], solving)}

lumo is slower with its solver without foreign libraries: Eigen's takes
{number(slower, 2)} times as long as
SuperLU at its best here, and more on larger systems.

{machine('scikit-fem', r)}

"""


def main():
    text = """# Beside its peers {#page_benchmarks}

[TOC]

This page compares what lumo and established programs take for the same task, both in one run, on one thread each, by
processor time. A ratio above 1 is how many times more the peer takes. The page is made from the figures of the runs.
`benchmarks/peers/run` makes all of it anew, from building to this text, and
`benchmarks/peers/run newton|mitsuba|botorch|scikit-fem` one part. The machine is shared with other work: ratios vary by
some ten per cent, and by more if memory counts. [Another page](../../benchmarks/peers/results.md) shows how lumo's
vertex block descent agrees with Newton's step by step.

"""
    for name, write in (("newton", newton), ("scikit_fem", scikit_fem), ("mitsuba", mitsuba), ("botorch", botorch)):
        if result := read(name):
            text += write(result)
    page = measured.HERE.parents[1] / "docs/pages/benchmarks.md"
    draft = page.with_suffix(".part")
    draft.write_text(wrapped(text.rstrip()) + "\n", encoding="utf-8")
    draft.replace(page)


if __name__ == "__main__":
    main()
