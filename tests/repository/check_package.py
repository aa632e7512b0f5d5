"""Makes the Debian packages, unpacks them into an empty root, and uses lumo from there: by find_package, by pkg-config,
and its program.

usage: check_package.py --cpack CPACK --ctest CTEST --generator G --compiler c++ --build DIR --scratch DIR
  --version X.Y.Z [--program] component…
"""

import argparse
import gzip
import os
import pathlib
import shutil
import stat
import subprocess
import sys

import check_pkg_config

LICENCES = [
    "MPL-2.0",
    "AGPL-3.0-or-later",
    "GPL-2.0-or-later",
    "LGPL-2.1-or-later",
    "Apache-2.0",
    "public domain",
    "BSD-2-Clause",
    "Permission is hereby granted",
]


def run(*command, **options):
    print(" ".join(map(str, command)), flush=True)
    done = subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)
    require(done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}")
    return done.stdout


def require(good, what):
    if not good:
        sys.exit(what)


def field(package, name):
    return run("dpkg-deb", "-f", package, name).strip()


def unpack(package, root):
    """A package must be right for every machine: owned by root, with plain rights, and all of it below /usr."""
    run("dpkg-deb", "-x", package, root)
    for line in run("dpkg-deb", "-c", package).splitlines():
        rights, owner, *_, name = line.split()
        require(owner == "root/root" and rights[1:] in ("rwxr-xr-x", "rw-r--r--"), f"{name}: {rights} of {owner}")
        require(name == "./" or name.startswith("./usr/"), f"{name} lies outside /usr")


def check_documents(root, package):
    folder = root / "usr/share/doc" / package
    text = (folder / "copyright").read_text(encoding="utf-8")
    for name in LICENCES:
        require(name in text, f"{package}: its copyright file does not speak of {name}")
    require("@" not in text.replace("@debian.org", ""), f"{package}: something was not put into its copyright file")
    changes = gzip.open(folder / "changelog.gz", "rt", encoding="utf-8").read()
    require(changes.startswith("# Changelog"), f"{package}: no changelog")
    changes = gzip.open(folder / "changelog.Debian.gz", "rt", encoding="utf-8").read()
    require(changes.startswith("lumo ("), f"{package}: no changelog of the package")


def main(a):
    scratch, root = pathlib.Path(a.scratch), pathlib.Path(a.scratch) / "root"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    run(
        a.cpack,
        "--config",
        f"{a.build}/CPackConfig.cmake",
        "-B",
        scratch / "made",
        "-D",
        f"CPACK_COMPONENTS_ALL={'headers;program' if a.program else 'headers'}",
    )
    made = {field(p, "Package"): p for p in sorted((scratch / "made").glob("*.deb"))}
    require(set(made) == {"liblumo-dev", *(["lumo-bin"] if a.program else [])}, f"packages made: {sorted(made)}")
    for name, package in made.items():
        require(
            field(package, "Version").split("-")[0] == a.version, f"{name} is of version {field(package, 'Version')}"
        )
        unpack(package, root)
        check_documents(root, name)

    headers = made["liblumo-dev"]
    require(
        field(headers, "Architecture") == "all" and "libeigen3-dev" in field(headers, "Depends"),
        "liblumo-dev: wrong architecture or dependencies",
    )
    unlinked = [p for p in root.rglob("*") if p.is_file() and "lumo-bin" not in p.parts and p.parent.name != "bin"]
    for path in unlinked:  # what is for every architecture must name no folder of this one
        if path.suffix in (".pc", ".cmake"):
            text = path.read_text(encoding="utf-8")
            require("linux-gnu" not in text and str(a.build) not in text, f"{path} names a folder of this machine")

    components = scratch / "components"
    run(
        a.ctest,
        "--build-and-test",
        pathlib.Path(__file__).parent / "components",
        components,
        "--build-generator",
        a.generator,
        "--build-options",
        f"-DCMAKE_PREFIX_PATH={root}/usr",
        f"-DCMAKE_CXX_COMPILER={a.compiler}",
        f"-DLUMO_VERSION={a.version}",
        f"-DLUMO_WANTED={';'.join(a.components)}",
        "--test-command",
        a.ctest,
        "--output-on-failure",
        "--no-tests=error",
    )
    cache = (components / "CMakeCache.txt").read_text()
    require(f"lumo_DIR:PATH={root}/usr/share/lumo/cmake" in cache, "another lumo was found than the unpacked one")
    check_pkg_config.check(a.compiler, root / "usr", a.version, a.components)

    if a.program:
        package = made["lumo-bin"]
        architecture = run("dpkg", "--print-architecture").strip()
        require(field(package, "Architecture") == architecture, "lumo-bin: wrong architecture")
        video = ["libopencv-videoio"] if "opencv" in a.components else []
        for library in ("libc6", "libtet", "libcholmod", "libembree", *video):
            require(
                library in field(package, "Depends"),
                f"lumo-bin does not depend on {library}: {field(package, 'Depends')}",
            )
        lumo = root / "usr/bin/lumo"
        require(os.stat(lumo).st_mode & stat.S_IXOTH, "lumo may not be run by all")
        require(a.version in run(lumo, "--version"), "lumo states another version")
        run(lumo, "section", "--theta", "6,6,8,5,0", "--out", scratch / "out")
        require("<svg" in (scratch / "out/section.svg").read_text(encoding="utf-8"), "no drawing")
        if {"opencv", "lz4", "zstd"} <= set(a.components):  # its module is found where it is installed
            done = subprocess.run([lumo, "decode", scratch / "none"], capture_output=True, text=True)
            require(done.returncode == 5 and "OpenCV" not in done.stderr, f"lumo decode: {done.stderr}")
    print("packages:", ", ".join(p.name for p in made.values()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("cpack", "ctest", "generator", "compiler", "build", "scratch", "version"):
        parser.add_argument("--" + name, required=True)
    parser.add_argument("--program", action="store_true")
    parser.add_argument("components", nargs="+")
    main(parser.parse_args())
