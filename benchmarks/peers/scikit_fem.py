#!/usr/bin/env python3
"""scikit-fem beside lumo's elements: forces and tangent of one bent finger in quadratic tetrahedra, and one linear step
with that tangent.

usage: benchmarks/peers/scikit_fem.py [--edge 3] [--rounds 2]

Both have the same mesh (curved faces), the same four quadrature points, and the plain displacement formulation of a
compressible Neo-Hookean solid. Writes scikit_fem.json. Processor seconds of one thread; rounds of both take turns.
"""

import argparse
import os
import pathlib
import statistics
import tempfile
import time

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import skfem
from skfem.helpers import ddot, grad, mul, transpose

import measured

MU, LAMBDA = 106.0e3, 10.494e6  # Dragon Skin
MIDDLES = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]  # of lumo's nodes 4 to 9


@skfem.LinearForm
def forces(v, w):
    return ddot(w["stress"], grad(v))


def change_of_stress(du, w):
    dF, G = grad(du), w["G"]  # G = F⁻ᵀ
    return MU * dF + w["pull"] * mul(mul(G, transpose(dF)), G) + LAMBDA * ddot(G, dF) * G


@skfem.BilinearForm
def tangent(du, v, w):
    return ddot(change_of_stress(du, w), grad(v))


def sparing_tangent():
    """The same; what depends on the trial function only is computed once for its thirty test functions, which
    scikit-fem goes through next to each other."""
    known = {"trial": None, "dP": None}

    def form(du, v, w):
        if known["trial"] is not du:
            known.update(trial=du, dP=change_of_stress(du, w))
        return ddot(known["dP"], grad(v))

    return skfem.BilinearForm(form)


class Peer:
    def __init__(self, folder):
        nodes = np.fromfile(folder / "nodes.f64").reshape(-1, 3)
        tets = np.fromfile(folder / "tets.i32", dtype=np.int32).reshape(-1, 10)
        corners = np.unique(tets[:, :4])
        number = np.full(len(nodes), -1)
        number[corners] = np.arange(len(corners))
        mesh = skfem.MeshTet2.from_mesh(skfem.MeshTet(nodes[corners].T, number[tets[:, :4]].T))
        edge_of = {tuple(sorted(e)): k for k, e in enumerate(mesh.edges.T)}
        node_of_edge = np.empty(mesh.edges.shape[1], dtype=int)
        for tet in tets:
            for k, (a, b) in enumerate(MIDDLES):
                node_of_edge[edge_of[tuple(sorted((number[tet[a]], number[tet[b]])))]] = tet[4 + k]
        places = mesh.doflocs.copy()
        places[:, len(corners) :] = nodes[node_of_edge].T
        self.mesh = skfem.MeshTet2(places, mesh.t)
        a, b = 0.58541019662496845446, 0.13819660112501051518
        points = np.full((3, 4), b)
        points[[0, 1, 2], [1, 2, 3]] = a
        self.basis = skfem.Basis(
            self.mesh, skfem.ElementVector(skfem.ElementTetP2()), quadrature=(points, np.full(4, 1 / 24))
        )
        self.dofs = np.empty((len(nodes), 3), dtype=int)  # of lumo's nodes
        self.dofs[corners] = self.basis.nodal_dofs.T
        self.dofs[node_of_edge] = self.basis.edge_dofs.T
        self.u = np.empty(self.basis.N)
        self.u[self.dofs] = np.fromfile(folder / "displacement.f64").reshape(-1, 3)
        self.elements, self.nodes = len(tets), len(nodes)

    def state(self):
        """Stress and what the tangent needs, at the quadrature points."""
        F = np.eye(3)[:, :, None, None] + self.basis.interpolate(self.u).grad
        at = np.moveaxis(F, (0, 1), (2, 3))
        G = np.moveaxis(np.linalg.inv(at), (2, 3), (1, 0))
        logJ = np.log(np.linalg.det(at))
        return {"G": G, "stress": MU * (F - G) + LAMBDA * logJ * G, "pull": MU - LAMBDA * logJ}

    def forces(self):
        return forces.assemble(self.basis, stress=self.state()["stress"])

    def tangent(self, form=tangent):
        w = self.state()
        return form.assemble(self.basis, G=w["G"], pull=w["pull"])


def seconds_of(function, *arguments):
    begun = time.process_time()
    result = function(*arguments)
    return time.process_time() - begun, result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edge", type=float, default=3.0, help="mesh size in mm")
    parser.add_argument("--rounds", type=int, default=2, help="of assembly; solutions go through two")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        half = measured.Half("lumo_peer_elements", folder, args.edge)
        setup, peer = seconds_of(Peer, folder)
        own_forces = np.fromfile(folder / "forces.f64").reshape(-1, 3)
        equations = np.fromfile(folder / "equations.i32", dtype=np.int32).reshape(-1, 3)
        lower = scipy.sparse.csc_matrix(
            tuple(
                np.fromfile(folder / n, dtype=t)
                for n, t in (("values.f64", "f8"), ("rows.i32", "i4"), ("starts.i32", "i4"))
            )
        )
        own = (lower + scipy.sparse.tril(lower, -1).T).tocsc()
        free = np.empty(own.shape[0], dtype=int)  # scikit-fem's numbers of lumo's equations
        free[equations[equations >= 0]] = peer.dofs[equations >= 0]

        rows = {
            "scikit-fem forces": [],
            "scikit-fem tangent": [],
            "scikit-fem sparing tangent": [],
            "lumo forces": [],
            "lumo tangent": [],
            "lumo cured forces": [],
            "lumo cured tangent": [],
        }
        peer.forces()  # what is set up at first use
        for _ in range(args.rounds):
            spent, f = seconds_of(peer.forces)
            rows["scikit-fem forces"].append(spent)
            spent, K = seconds_of(peer.tangent)
            rows["scikit-fem tangent"].append(spent)
            spent, spared = seconds_of(peer.tangent, sparing_tangent())
            rows["scikit-fem sparing tangent"].append(spent)
            for kind, label in (("plain", "lumo"), ("cured", "lumo cured")):
                a, b = map(float, half.ask(f"assemble {kind} 10").split())
                rows[f"{label} forces"].append(a)
                rows[f"{label} tangent"].append(b)
        if abs(spared - K).max() > 1e-12 * abs(K).max():
            raise RuntimeError("the two forms of the tangent differ")
        K = K.tocsr()[free][:, free].tocsc()
        differs = {
            "forces": float(np.abs(f[peer.dofs] - own_forces).max() / np.abs(own_forces).max()),
            "tangent": float(abs(K - own).max() / abs(own).max()),
        }

        right, steps = -f[free], {}
        default, symmetric = (
            "SuperLU by scikit-fem's solve (COLAMD)",
            "SuperLU, symmetric mode (minimum degree of A + Aᵀ)",
        )
        solving = {default: [], symmetric: [], "lumo, Eigen's Cholesky": [], "lumo, CHOLMOD": []}
        for _ in range(2):
            spent, steps[default] = seconds_of(lambda: skfem.solve(K, right))
            solving[default].append(spent)
            spent, steps[symmetric] = seconds_of(
                lambda: scipy.sparse.linalg.splu(
                    K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                ).solve(right)
            )
            solving[symmetric].append(spent)
            for label, kind in (("lumo, Eigen's Cholesky", "eigen"), ("lumo, CHOLMOD", "cholmod")):
                solving[label].append(sum(map(float, half.ask(f"solve {kind}").split())))
                steps[label] = np.fromfile(folder / "step.f64")
        half.close()
    best = steps["lumo, CHOLMOD"]
    measured.keep(
        "scikit_fem",
        {
            "edge_mm": args.edge,
            "nodes": peer.nodes,
            "elements": peer.elements,
            "equations": len(free),
            "rounds": args.rounds,
            "differs": differs,
            "setup_seconds": setup,
            "assembly_seconds": {k: statistics.median(v) for k, v in rows.items()},
            "solution_seconds": {k: min(v) for k, v in solving.items()},
            "step_differs": {k: float(np.linalg.norm(v - best) / np.linalg.norm(best)) for k, v in steps.items()},
        },
        ["scikit-fem", "scipy", "numpy"],
    )


if __name__ == "__main__":
    main()
