"""Light in a scattering box by Mitsuba 3, the peer of lumo's ScatteringMedium. Writes a reference file that lumo's
tests read.

usage: mitsuba_scattering.py [--samples N] [--variant scalar_rgb] [--out tests/optics/mitsuba_scattering.csv]

A box of 10 x 8 x 6 mm stands in air; a square of 2 mm about (-1, 0.5) mm, 0.5 mm above its floor, radiates 1 W upwards
with a cosine law. What leaves through the top (+z), one side (+x) and the floor (-z) is the mean of an irradiance meter
on each face times its area, by Mitsuba's volumetric path tracer (integrator volpath): a path from the face into the
box, with next-event estimation at each scattering.
"""

import argparse
import math
import os
import pathlib

import mitsuba as mi

# index, extinction [1/m], albedo, anisotropy
CASES = [(1.0, 150.0, 0.8, 0.7), (1.0, 600.0, 0.95, 0.0), (1.3, 150.0, 0.8, 0.7), (1.3, 600.0, 0.95, 0.9)]
HALF_MM = (5.0, 4.0, 3.0)


def scene(index, extinction_per_m, albedo, anisotropy, face):
    T = mi.ScalarTransform4f
    x, y, z = HALF_MM
    medium = {
        "type": "homogeneous",
        "sigma_t": extinction_per_m * 1e-3,
        "albedo": albedo,
        "phase": {"type": "hg", "g": anisotropy},
    }
    surface = {"type": "null"} if index == 1.0 else {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
    film = {"type": "hdrfilm", "width": 1, "height": 1, "pixel_format": "luminance", "rfilter": {"type": "box"}}
    # The meter lies a little outside its face and looks at it.
    gap = 1e-4
    place = {
        "top": T().translate([0, 0, z + gap]).rotate([1, 0, 0], 180).scale([x, y, 1]),
        "side": T().translate([x + gap, 0, 0]).rotate([0, 1, 0], -90).scale([z, y, 1]),
        "floor": T().translate([0, 0, -z - gap]).scale([x, y, 1]),
    }[face]
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": 2000, "rr_depth": 50},
            "box": {"type": "cube", "to_world": T().scale([x, y, z]), "interior": medium, "surface": surface},
            "lamp": {
                "type": "rectangle",
                "to_world": T().translate([-1, 0.5, 0.5 - z]),
                "bsdf": {"type": "null"},
                "emitter": {"type": "area", "radiance": 1.0 / (math.pi * 4.0)},
            },
            "meter": {
                "type": "rectangle",
                "to_world": place,
                "bsdf": {"type": "null"},
                "sensor": {"type": "irradiancemeter", "film": film},
            },
        }
    )


def power(case, face, samples):
    """Watts through a face and the standard error of their mean, from 16 renderings."""
    x, y, z = HALF_MM
    area = {"top": 4 * x * y, "side": 4 * z * y, "floor": 4 * x * y}[face]
    s, runs = scene(*case, face), 16
    values = [float(mi.render(s, spp=max(1, samples // runs), seed=seed).numpy().mean()) * area for seed in range(runs)]
    mean = sum(values) / runs
    return mean, math.sqrt(sum((v - mean) ** 2 for v in values) / (runs * (runs - 1)))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", type=int, default=1 << 20)
    parser.add_argument("--variant", default="scalar_rgb", help="llvm_ad_mono is faster where LLVM works")
    parser.add_argument(
        "--out", default=str(pathlib.Path(__file__).resolve().parents[2] / "tests/optics/mitsuba_scattering.csv")
    )
    arguments = parser.parse_args()
    mi.set_variant(arguments.variant)
    lines = [
        f"# Mitsuba {mi.__version__}, volpath, {arguments.samples} paths a value: benchmarks/peers/mitsuba_scattering.py",
        "index,extinction_per_m,albedo,anisotropy,face,power_W,error_W",
    ]
    for case in CASES:
        for face in ("top", "side", "floor"):
            value, error = power(case, face, arguments.samples)
            lines.append(",".join(f"{v:g}" for v in case) + f",{face},{value:.6f},{error:.6f}")
            print(lines[-1], flush=True)
    draft = arguments.out + ".part"
    with open(draft, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
    os.replace(draft, arguments.out)


if __name__ == "__main__":
    main()
