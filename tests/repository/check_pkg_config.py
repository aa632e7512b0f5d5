"""Builds one small program for each component with the flags that pkg-config gives, and runs it.

usage: check_pkg_config.py --compiler c++ --prefix DIR --version X.Y.Z component…
DIR is where lumo is installed, such as the usr folder of an unpacked package.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

SOURCES = pathlib.Path(__file__).parent / "components"


def run(command, **options):
    print(" ".join(command), flush=True)
    done = subprocess.run(command, capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout.split()


def check(compiler, prefix, version, components):
    environment = dict(os.environ, PKG_CONFIG_PATH=f"{prefix}/share/pkgconfig")
    names = ["lumo", *(f"lumo-{c}" for c in components)]
    for name in names:
        if run(["pkg-config", "--modversion", name], env=environment) != [version]:
            sys.exit(f"{name}.pc is not of version {version}")
        folder = run(["pkg-config", "--variable=includedir", name], env=environment)[0]
        if not os.path.samefile(folder, f"{prefix}/include"):
            sys.exit(f"{name}.pc is not the one of {prefix}: it names {folder}")
    with tempfile.TemporaryDirectory() as scratch:
        for component in components:
            flags = {
                kind: run(["pkg-config", f"--{kind}", f"lumo-{component}"], env=environment)
                for kind in ("cflags", "libs")
            }
            program = f"{scratch}/{component}"
            run(
                [
                    compiler,
                    "-std=c++20",
                    f'-DWANTED_VERSION="{version}"',
                    *flags["cflags"],
                    str(SOURCES / f"{component}.cpp"),
                    "-o",
                    program,
                    *flags["libs"],
                ]
            )
            run([program], cwd=scratch)
    print(f"pkg-config: lumo and {len(components)} components build and run")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--prefix", required=True)
    parser.add_argument("--version", required=True)
    parser.add_argument("components", nargs="+")
    arguments = parser.parse_args()
    check(arguments.compiler, arguments.prefix, arguments.version, arguments.components)
