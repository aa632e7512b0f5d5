#!/usr/bin/env python3
"""Newton's vertex block descent beside lumo's: one mesh of linear tetrahedra, one schedule, Newton's own color groups
and predictor.

usage: benchmarks/peers/newton_vbd.py [--lumo build/release/benchmarks/lumo_newton_vbd] [--edges 2,1.5] [--sweeps 10]
       [--loads 1,2,5] [--hold 0.2] [--stiffness 1000] [--viscosity 10] [--friction 0,0.5] [--interior]
       [--out FILE]

Newton (CPU, one thread, steps replayed from a captured graph) presses a sphere of 10 mm into the baseline finger: 5
mm/s until each load is met, then a hold. lumo goes through the same advances. The table has, per recorded state, the
contact forces of both (the relative difference over all steps in contact, largest and at the state), the largest
distance between vertices over the pad's height, and the CPU time of a sweep per vertex. What remains between them is
float32 against float64. Newton lets every vertex touch the sphere, also those below the surface, which a dent between
coarse vertices reaches: they are taken out of its list of pairs unless --interior keeps them.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

DT, SPEED, RADIUS, DENSITY, MU, LAMBDA = 0.01, 5e-3, 5e-3, 1070.0, 106.0e3, 10.494e6


def surface_vertices(tets):
    """Vertices of the triangles that belong to one tetrahedron only."""
    sides = np.sort(
        np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]]), axis=1
    )
    sides, count = np.unique(sides, axis=0, return_counts=True)
    return np.unique(sides[count == 1])


class Newton:
    """The finger, bonded at the carrier, and a kinematic sphere."""

    def __init__(self, nodes, tets, bonded, touch, *, sweeps, stiffness, viscosity, friction, interior=False):
        import newton
        import warp as wp

        wp.config.quiet = True
        wp.set_device("cpu")
        self.wp = wp
        builder = newton.ModelBuilder()
        builder.gravity = (0.0, 0.0, 0.0)
        builder.add_soft_mesh(
            pos=wp.vec3(0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=wp.vec3(0.0),
            vertices=[wp.vec3(*p) for p in nodes],
            indices=tets.ravel().tolist(),
            density=DENSITY,
            k_mu=MU,
            k_lambda=LAMBDA,
            k_damp=viscosity,
            add_surface_mesh_edges=False,
            particle_radius=0.0,
        )
        for k in np.flatnonzero(bonded):
            builder.particle_mass[k] = 0.0
        cfg = newton.ModelBuilder.ShapeConfig(ke=stiffness, kd=0.0, mu=friction, margin=0.0, gap=0.0)
        self.origin = np.asarray(touch)
        body = builder.add_body(xform=wp.transform(wp.vec3(*self.origin), wp.quat_identity()), is_kinematic=True)
        builder.add_shape_sphere(body, radius=RADIUS, cfg=cfg)
        builder.color()
        model = builder.finalize(device="cpu")
        model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = stiffness, 0.0, friction
        self.model, self.colors = model, [g.numpy() for g in model.particle_color_groups]
        self.pipeline = newton.CollisionPipeline(model, soft_contact_gap=1e-3)
        if not interior:
            pairs = self.pipeline.soft_rigid_contact_pairs.numpy()
            pairs = pairs[np.isin(pairs[:, 0], surface_vertices(tets))]
            self.pipeline.soft_rigid_contact_pairs = wp.array(pairs, dtype=wp.vec2i, device="cpu")
            self.pipeline._soft_contact_pair_count = len(pairs)
        self.contacts = self.pipeline.contacts()
        self.solver = newton.solvers.SolverVBD(model, iterations=sweeps)
        kind = newton.solvers.SolverBase.ObservableKind.CONTACT_F
        self.observables = self.solver.observables(contacts=self.contacts, kinds={kind})
        self.state, self.after = model.state(), model.state()
        self.advance, self.seconds, self.steps, self.graph = 0.0, 0.0, 0, None

    def _step(self):
        wp = self.wp
        self.pipeline.collide(self.state, self.contacts)
        self.solver.step(self.state, self.after, None, self.contacts, DT, observables=self.observables)
        wp.copy(self.state.particle_q, self.after.particle_q)
        wp.copy(self.state.particle_qd, self.after.particle_qd)

    def step(self, by):
        wp = self.wp
        self.advance += by
        pose = np.array([[*(self.origin - [0.0, 0.0, self.advance]), 0.0, 0.0, 0.0, 1.0]], dtype=np.float32)
        self.state.body_q.assign(pose)
        begun = time.process_time()
        if self.steps < 2:
            self._step()  # the first compiles kernels and allocates
        else:
            if self.graph is None:
                with wp.ScopedCapture(device="cpu") as capture:
                    self._step()
                self.graph = capture.graph
                begun = time.process_time()
            wp.capture_launch(self.graph)
            self.seconds += time.process_time() - begun
        self.steps += 1
        return self.force()

    def force(self):
        count = int(self.contacts.soft_contact_count.numpy()[0])
        start = self.contacts.rigid_contact_max
        return (
            float(self.observables.contact_f.numpy()[start : start + count, 2].astype(np.float64).sum())
            if count
            else 0.0
        )

    def positions(self):
        return self.state.particle_q.numpy().astype(np.float64)


def compare(driver, edge, friction, args):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        subprocess.run([driver, "mesh", folder, str(edge)], check=True)
        nodes = np.fromfile(folder / "nodes.f64").reshape(-1, 3)
        tets = np.fromfile(folder / "tets.i32", dtype=np.int32).reshape(-1, 4)
        bonded = np.fromfile(folder / "bonded.i32", dtype=np.int32)
        peer = Newton(
            nodes,
            tets,
            bonded,
            np.fromfile(folder / "touch.f64"),
            sweeps=args.sweeps,
            stiffness=args.stiffness,
            viscosity=args.viscosity,
            friction=friction,
            interior=args.interior,
        )
        (folder / "colors.txt").write_text("\n".join(" ".join(map(str, g)) for g in peer.colors) + "\n")
        schedule, forces, states, depths, met = [], [], [], [], []
        for load in args.loads:
            while not forces or forces[-1] < load:
                if peer.advance > 6e-3:
                    sys.exit(f"{load} N is not met within 6 mm")
                forces.append(peer.step(SPEED * DT))
                schedule.append((SPEED * DT, 0))
            met.append(forces[-1])
            for k in range(round(args.hold / DT)):
                forces.append(peer.step(0.0))
                schedule.append((0.0, 0))
            schedule[-1] = (schedule[-1][0], 1)
            states.append(peer.positions())
            depths.append(peer.advance)
        (folder / "schedule.txt").write_text("".join(f"{by:.17g} {keep}\n" for by, keep in schedule))
        run = [
            driver,
            "run",
            folder,
            str(edge),
            str(args.sweeps),
            str(args.stiffness),
            str(args.viscosity),
            str(friction),
            "1",
            "3",
        ]
        seconds = float(subprocess.run(run, check=True, capture_output=True, text=True).stdout)
        own = np.fromfile(folder / "forces.f64")
        own_states = np.fromfile(folder / "states.f64").reshape(len(states), -1, 3)
    forces = np.array(forces)
    free = np.flatnonzero(bonded == 0)
    sweeps = args.sweeps * len(free)
    touching = forces > 0.05 * args.loads[0]
    worst = np.abs(own[touching] / forces[touching] - 1).max()
    height = nodes[:, 2].max()
    per_newton, per_lumo = peer.seconds / (peer.steps - 2) / sweeps, seconds / len(schedule) / sweeps
    rows = []
    ends = np.flatnonzero([keep for _, keep in schedule])
    for k, load in enumerate(args.loads):
        apart = np.linalg.norm(own_states[k] - states[k], axis=1)
        moved = np.linalg.norm(states[k] - nodes, axis=1).max()
        rows.append(
            f"| {edge} | {len(nodes)} | {friction} | {load} | {1e3 * depths[k]:.2f} | {met[k]:.4f} | {forces[ends[k]]:.5f} | {own[ends[k]]:.5f} | "
            f"{100 * abs(own[ends[k]] / forces[ends[k]] - 1):.4f} | {100 * worst:.4f} | {apart.max() / height:.1e} | {1e3 * moved:.2f} | "
            f"{1e6 * per_newton:.3f} | {1e6 * per_lumo:.3f} | {per_newton / per_lumo:.1f} |"
        )
    return rows


def numbers(kind):
    return lambda text: [kind(word) for word in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--lumo", default="build/release/benchmarks/lumo_newton_vbd", help="lumo's half of the comparison"
    )
    parser.add_argument("--edges", type=numbers(float), default=[2.0, 1.5], help="mesh sizes in mm")
    parser.add_argument("--sweeps", type=int, default=10)
    parser.add_argument("--loads", type=numbers(float), default=[1.0, 2.0, 5.0], help="N")
    parser.add_argument("--hold", type=float, default=0.2, help="s at each load")
    parser.add_argument("--stiffness", type=float, default=1000.0, help="contact stiffness of a vertex in N/m")
    parser.add_argument("--viscosity", type=float, default=10.0, help="Pa s")
    parser.add_argument("--friction", type=numbers(float), default=[0.0, 0.5])
    parser.add_argument(
        "--interior", action="store_true", help="Newton's own contact pairs, vertices below the surface among them"
    )
    parser.add_argument("--out", type=pathlib.Path, help="also write the table here")
    args = parser.parse_args()
    lines = [
        "| edge mm | vertices | friction | load N | depth mm | met N | Newton N | lumo N | force differs % | at worst % | vertices apart / height | "
        "moved mm | Newton µs/sweep/vertex | lumo | ratio |",
        "|" + "---|" * 15,
    ]
    print("\n".join(lines), flush=True)
    for edge in args.edges:
        for friction in args.friction:
            rows = compare(args.lumo, edge, friction, args)
            print("\n".join(rows), flush=True)
            lines += rows
    if args.out:
        args.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
