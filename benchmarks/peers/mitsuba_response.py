#!/usr/bin/env python3
"""Mitsuba 3 beside lumo's tracer: the response of the unloaded baseline pad, eleven bins along the finger, and what an
error of it costs.

usage: benchmarks/peers/mitsuba_response.py [--seeds 24] [--launches 4] [--paths 262144] [--variant llvm_ad_mono]

No integrator that comes with Mitsuba gives the power that leaves through regions of a surface, so the peer is a loop in
Dr.Jit such as its users write: from the LEDs forward; at the clear surface what passes is booked at once, as it leaves
a convex pad for good, and what is reflected goes on; Lambertian carrier; Russian roulette. Triangles, normals and
numbers are lumo's. Errors are those over seeds: root mean square over the bins' sum, as a share of the response's norm.
Writes mitsuba.json. Processor seconds; one thread; seeds of both take turns.
"""

import argparse
import json
import os
import pathlib
import tempfile
import time

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"
import drjit as dr
import mitsuba as mi
import numpy as np

import measured

WAYS = [
    ("gathered", 0.0625, 0),
    ("gathered", 0.25, 0),
    ("gathered", 1, 0),
    ("gathered", 1, 1),
    ("forward", 1, 0),
]  # of lumo: way, rays by the default, symmetry used


class Peer:
    """Lengths in mm: Mitsuba sets its rays off from surfaces by about 1e-4 of a scene's coordinates."""

    def __init__(self, folder):
        self.data = data = json.loads((folder / "scene.json").read_text())
        corners = 1e3 * np.fromfile(folder / "corners.f64").reshape(-1, 3)
        normals = np.fromfile(folder / "normals.f64").reshape(-1, 3)
        mesh = mi.Mesh("pad", vertex_count=len(corners), face_count=len(corners) // 3, has_vertex_normals=True)
        values = mi.traverse(mesh)
        values["vertex_positions"] = mi.Float(corners.ravel().astype(np.float32))
        values["vertex_normals"] = mi.Float(normals.ravel().astype(np.float32))
        values["faces"] = mi.UInt32(np.arange(len(corners), dtype=np.uint32))
        values.update()
        self.scene = mi.load_dict({"type": "scene", "pad": mesh})
        self.diffuse = mi.UInt32(np.fromfile(folder / "diffuse.i32", dtype=np.int32).astype(np.uint32))
        # Opaque: numbers that are known to the kernel would have it compiled again.
        self.index, self.extinction, self.albedo = (
            dr.opaque(mi.Float, data[k] * f)
            for k, f in (("refractive_index", 1), ("extinction_per_m", 1e-3), ("albedo", 1))
        )

    def response(self, paths, seed, roulette_below=0.2):
        """[W] per bin of 1 W, and what was lost."""
        d = self.data
        bins = dr.zeros(mi.Float64, d["bins"] + 1)
        trace(
            self.scene,
            mi.PCG32(size=paths, initstate=seed),
            paths,
            bins,
            self.diffuse,
            self.index,
            self.extinction,
            self.albedo,
            d,
            roulette_below,
        )
        dr.eval(bins)
        dr.sync_thread()
        power = bins.numpy() / paths
        return power[:-1], power[-1]


@dr.syntax
def trace(scene, rng, paths, bins, diffuse, index, extinction, albedo, d, roulette_below):
    mm = 1e3
    led = mi.Int32(dr.minimum(mi.Float(d["leds"]) * rng.next_float32(), d["leds"] - 1))
    x = mm * d["led_x_m"] * (rng.next_float32() - 0.5)
    y = mm * (d["led_pitch_m"] * (mi.Float(led) - 0.5 * (d["leds"] - 1)) + d["led_y_m"] * (rng.next_float32() - 0.5))
    ray = mi.Ray3f(
        mi.Point3f(x, y, mm * d["led_z_m"] + 3e-3),
        mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32())),
    )
    w = dr.ones(mi.Float, paths)
    active = dr.full(mi.Bool, True, paths)
    events = dr.zeros(mi.UInt32, paths)
    while active:
        si = scene.ray_intersect(ray, active)
        found = si.is_valid()
        dr.scatter_add(bins, mi.Float64(w), mi.UInt32(d["bins"]), active & ~found)  # leaked
        active &= found
        w *= dr.exp(-extinction * si.t)
        white = dr.gather(mi.UInt32, diffuse, si.prim_index, active) == 1

        normal = si.sh_frame.n
        cosine = dr.maximum(dr.dot(ray.d, normal), 0.0)
        reflected, _, _, _ = mi.fresnel(-cosine, index)
        height = mm * d["flank_m"]
        nx = si.p.x / (mm * d["half_width_m"]) ** 2
        nz = dr.maximum(si.p.z - height, 0.0) / (mm * d["dome_m"]) ** 2
        seen = (dr.abs(nx) >= d["min_abs_nx"] * dr.sqrt(nx * nx + nz * nz)) & (dr.abs(si.p.y) <= mm * d["half_range_m"])
        place = mi.UInt32(dr.clip((si.p.y / (mm * d["half_range_m"]) + 1.0) * (0.5 * d["bins"]), 0.0, d["bins"] - 1.0))
        dr.scatter_add(bins, mi.Float64(w * (1.0 - reflected)), place, active & ~white & seen)

        mirrored = ray.d - 2.0 * dr.dot(ray.d, normal) * normal
        mirrored = dr.select(dr.dot(mirrored, si.n) < 0.0, mirrored, ray.d - 2.0 * dr.dot(ray.d, si.n) * si.n)
        scattered = mi.Frame3f(-si.n).to_world(
            mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
        )
        w *= dr.select(white, albedo, reflected)
        survives = rng.next_float32() * (2.0 * roulette_below) < w
        low = w < roulette_below
        active &= ~low | survives
        w = dr.select(low, 2.0 * roulette_below, w)
        events += 1
        active &= events < 4096
        ray = si.spawn_ray(dr.select(white, scattered, mirrored))


def quality(runs):
    """Mean response, standard error of it per bin, relative error of one run, and processor seconds of one."""
    powers = np.array([p for p, _ in runs])
    mean, variance = powers.mean(0), powers.var(0, ddof=1)
    return (
        mean,
        np.sqrt(variance / len(runs)),
        float(np.sqrt(variance.sum()) / np.linalg.norm(mean)),
        float(np.mean([s for _, s in runs])),
    )


def compare(material, args):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        half = measured.Half("lumo_peer_light", folder, material)
        begun = time.process_time()
        peer = Peer(folder)
        peer.response(args.paths, 10**6)
        first = time.process_time() - begun
        theirs, own, lost = [], {way: [] for way in WAYS}, 0.0
        for seed in range(args.seeds):
            for k in range(args.launches):
                begun = time.process_time()
                power, leaked = peer.response(args.paths, seed * args.launches + k)
                theirs.append((power, time.process_time() - begun))
                lost = max(lost, leaked)
            for way, factor, fold in WAYS:
                answer = json.loads(half.ask(f"{way} {factor} {seed + 1} {fold}"))
                own[way, factor, fold].append((answer["power_W"], answer["seconds"]))
        half.close()
    mean, error, peer_error, peer_seconds = quality(theirs)
    result = {
        "material": material,
        "triangles": peer.data["triangles"],
        "paths": args.paths,
        "launches": len(theirs),
        "first_launch_seconds": first,
        "lost": float(lost),
        "mitsuba": {
            "error": peer_error,
            "seconds": peer_seconds,
            "power_W": mean.tolist(),
            "standard_error_W": error.tolist(),
        },
        "lumo": [],
    }
    for (way, factor, fold), runs in own.items():
        m, e, relative, seconds = quality(runs)
        z = (m - mean) / np.hypot(e, error)
        result["lumo"].append(
            {
                "way": way,
                "factor": factor,
                "symmetry": bool(fold),
                "error": relative,
                "seconds": seconds,
                "power_W": m.tolist(),
                "standard_error_W": e.tolist(),
                "largest_z": float(np.abs(z).max()),
                "chi2_per_bin": float((z * z).mean()),
                "differs": float(np.linalg.norm(m - mean) / np.linalg.norm(mean)),
                "expected_to_differ": float(np.sqrt((e**2 + error**2).sum()) / np.linalg.norm(mean)),
                "efficiency_ratio": peer_error**2 * peer_seconds / (relative**2 * seconds),
            }
        )
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--launches", type=int, default=4, help="of Mitsuba per seed of lumo")
    parser.add_argument("--paths", type=int, default=1 << 18, help="of Mitsuba per launch")
    parser.add_argument("--variant", default="llvm_ad_mono")
    args = parser.parse_args()
    mi.set_variant(args.variant)
    dr.set_thread_count(1)
    measured.keep(
        "mitsuba",
        {"variant": args.variant, "seeds": args.seeds, "cases": [compare(m, args) for m in ("DS", "Sol")]},
        ["mitsuba", "drjit", "numpy"],
    )


if __name__ == "__main__":
    main()
