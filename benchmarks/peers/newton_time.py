#!/usr/bin/env python3
"""What depth and equilibrium cost: Newton's vertex block descent beside lumo's quasi-static solver, the finger pressed
to 5 N by a sphere of 10 mm.

usage: benchmarks/peers/newton_time.py [--edges 2,1.5,1] [--sweeps 10] [--stiffness 1e5] [--stay 1] [--longest 6]

For each edge, Newton (newton_vbd.py's class, frictionless) has a mesh of linear tetrahedra. lumo finds the equilibrium
of that mesh under 5 N, with the same energy and contact; Newton's sphere then goes to that depth at 5 mm/s and holds,
until the force has stayed within 1 % of 5 N for --stay s; its time is that up to the first step from which it stayed.
The depth at 5 N is that one, less the force's last deviation over the stiffness. Then lumo's own mesh and element at
several sizes. The reference depth is read from benchmarks/reference/results.md. Writes newton.json. Processor seconds
of one thread, without meshing, and without Newton's compilation and capture; the repeats of lumo are done before,
between and after.
"""

import argparse
import json
import math
import pathlib
import re
import subprocess
import tempfile

import numpy as np

import measured
from newton_vbd import DT, SPEED, Newton, numbers

LOAD = 5.0
SOFT = 1000.0  # N/m of a vertex, as in newton_vbd.py's table: overlaps then make up for what linear tetrahedra lock
QUADRATIC = [
    (0.2, 2.0),
    (0.4, 3.0),
    (0.8, 4.0),
    (1.5, 5.0),
]  # finest and contact edge in mm; the first is `lumo press`'s


def reference():
    """Depth at 5 N in mm, extrapolated from Taylor–Hood elements, and what it may be off by."""
    text = (measured.HERE.parent / "reference/results.md").read_text(encoding="utf-8")
    section = text[text.index("### [6, 6, 8, 5, 0], d = 10 mm, alpha = 0 deg, y = 0 mm") :]
    header, row = (re.search(rf"^\| {word}.*$", section, re.M)[0].split("|") for word in ("quantity", "depth 5 N"))
    at = [h.strip() for h in header].index("extrapolated")
    return float(row[at]), float(row[at + 1])


def static(*words):
    run = subprocess.run(
        [measured.BUILT / "benchmarks/lumo_peer_press", *map(str, words)], check=True, capture_output=True, text=True
    )
    return json.loads(run.stdout)


def held(edge, depth_mm, args):
    """Force and processor seconds after each step of Newton, and its numbers of vertices."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([measured.BUILT / "benchmarks/lumo_newton_vbd", "mesh", folder, str(edge)], check=True)
        nodes = np.fromfile(folder / "nodes.f64").reshape(-1, 3)
        tets = np.fromfile(folder / "tets.i32", dtype=np.int32).reshape(-1, 4)
        peer = Newton(
            nodes,
            tets,
            np.fromfile(folder / "bonded.i32", dtype=np.int32),
            np.fromfile(folder / "touch.f64"),
            sweeps=args.sweeps,
            stiffness=args.stiffness,
            viscosity=10.0,
            friction=0.0,
        )
    forces, seconds = [], []
    steps = math.ceil(1e-3 * depth_mm / (SPEED * DT) - 1e-9)
    inside = 0
    for k in range(steps + round(args.longest / DT)):
        forces.append(peer.step(min(SPEED * DT, 1e-3 * depth_mm - peer.advance)))
        seconds.append(peer.seconds)
        inside = inside + 1 if k >= steps and abs(forces[-1] / LOAD - 1) <= 0.01 else 0
        if inside > args.stay / DT:
            break
    per_step = peer.seconds / (peer.steps - 2)  # the first two steps compile
    return np.array(forces), np.array(seconds) + 2 * per_step, steps


def compare(edge, args):
    equilibrium = static("linear", edge, args.stiffness)
    forces, seconds, steps = held(edge, equilibrium["depth_mm"], args)
    again = static("linear", edge, args.stiffness)
    soft = static("linear", edge, SOFT)
    outside = np.flatnonzero(np.abs(forces / LOAD - 1) > 0.01)
    first = outside[-1] + 1
    settled = first < len(forces)
    after = forces[steps:]
    return {
        "edge_mm": edge,
        "nodes": equilibrium["nodes"],
        "static_depth_mm": equilibrium["depth_mm"],
        "N_per_mm": equilibrium["N_per_mm"],
        "static_seconds": min(equilibrium["seconds"], again["seconds"]),
        "factors": equilibrium["factors"],
        "soft_depth_mm": soft["depth_mm"],
        "steps_to_depth": steps,
        "steps": len(forces),
        "seconds_per_step": seconds[-1] / len(forces),
        "arrived_N": forces[steps - 1],
        "arrived_seconds": seconds[steps - 1],
        "least_N": after.min(),
        "largest_N": after.max(),
        "last_N": forces[-1],
        "settled": bool(settled),
        "settled_step": int(first),
        "settled_seconds": seconds[first] if settled else seconds[-1],
        "depth_mm": equilibrium["depth_mm"] - (forces[-1] - LOAD) / equilibrium["N_per_mm"],
    }


def order(x, y):
    """Exponent and factor of y = a xᵖ, least squares in logarithms."""
    p, a = np.polyfit(np.log(x), np.log(y), 1)
    return float(p), float(np.exp(a))


def beyond(rows):
    """Edge at which 1 % would be met by the order that the meshes show, and the least time that it would take: as many
    steps as the finest mesh, each more expensive only by its vertices."""
    edges = [r["edge_mm"] for r in rows]
    p, a = order(edges, [abs(r["error"]) for r in rows])
    q, _ = order(edges, [r["settled_seconds"] for r in rows])
    edge = (0.01 / a) ** (1 / p)
    finest = min(rows, key=lambda r: r["edge_mm"])
    return {
        "error_order": p,
        "time_order": q,
        "edge_mm": edge,
        "least_seconds": finest["settled_seconds"] * (finest["edge_mm"] / edge) ** 3,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edges", type=numbers(float), default=[2.0, 1.5, 1.0], help="mesh sizes of Newton in mm")
    parser.add_argument("--sweeps", type=int, default=10, help="per time step of 0.01 s; Newton's own number")
    parser.add_argument("--stiffness", type=float, default=1e5, help="contact stiffness of a vertex in N/m")
    parser.add_argument("--stay", type=float, default=1.0, help="s that the force must stay within 1 %% for")
    parser.add_argument("--longest", type=float, default=6.0, help="s of hold after which it is given up")
    args = parser.parse_args()
    depth, uncertainty = reference()
    own = {size: [static("quadratic", *size)] for size in QUADRATIC}
    rows = []
    for edge in args.edges:
        rows.append(compare(edge, args))
        print(rows[-1], flush=True)
        for size in QUADRATIC:
            own[size].append(static("quadratic", *size))
        lumo = [
            {"finest_mm": size[0], "contact_mm": size[1], **runs[0], "seconds": min(r["seconds"] for r in runs)}
            for size, runs in own.items()
        ]
        for row in lumo + rows:
            row["error"] = row["depth_mm"] / depth - 1
        result = {
            "load_N": LOAD,
            "reference_mm": depth,
            "reference_uncertainty_mm": uncertainty,
            "sweeps": args.sweeps,
            "time_step_s": DT,
            "stiffness_N_per_m": args.stiffness,
            "soft_N_per_m": SOFT,
            "stay_s": args.stay,
            "lumo": lumo,
            "newton": rows,
        }
        if len(rows) > 1:
            result["extrapolated"] = beyond(rows)
        measured.keep(
            "newton", result, ["newton", "warp-lang", "numpy"]
        )  # a fine mesh takes long: what is known by then is kept


if __name__ == "__main__":
    main()
