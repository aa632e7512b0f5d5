"""Pictures of a virtual log as codecs keep them at their default quality, and what lumo locate makes of a free finger then.

    lumo lab force --coarse --seed 7 --out LOG7          # and other seeds
    python benchmarks/sense/field_codecs.py LUMO LOG7 LOG8 … > table.md

A frame is free where the true force is below 0.05 N. The joint's free motion before 9.5 s is left out. Exits with 1 where a
free frame is touched with a probability above 0.9. Needs numpy, opencv-python-headless and av."""

import csv
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
from fractions import Fraction

import av
import cv2
import numpy as np
from field_variants import Log

FROM_NS = 9_500_000_000
RATE = 30

VIDEOS = [  # name, encoder, ending; their defaults
    ("H.264 (x264)", "libx264", ".mp4"),
    ("H.265 (x265)", "libx265", ".mp4"),
    ("MPEG-4 part 2", "mpeg4", ".mp4"),
    ("MPEG-2", "mpeg2video", ".mpg"),
    ("VP8", "libvpx", ".webm"),
    ("VP9", "libvpx-vp9", ".webm"),
    ("AV1 (SVT)", "libsvtav1", ".mp4"),
    ("Motion JPEG", "mjpeg", ".avi"),
    ("FFV1, no loss", "ffv1", ".mkv"),
]
PICTURES = [  # name, ending, OpenCV's quality
    ("PNG", ".png", []),
    ("JPEG 95", ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95]),
    ("JPEG 80", ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 80]),
    ("WebP 80", ".webp", [cv2.IMWRITE_WEBP_QUALITY, 80]),
]


def rows_of(folder, name):
    with open(folder / f"{name}.csv") as file:
        return list(csv.DictReader(file))


def write_pictures(log, folder, ending, quality):
    log = log.copy()
    log.tables["frames"]["file"] = [pathlib.Path(f).stem + ending for f in log.tables["frames"]["file"]]
    log.write(folder, quality)


def write_video(log, folder, encoder, ending):
    log = log.copy()
    log.session["video"] = "video" + ending
    del log.tables["frames"]["file"]
    log.write_tables(folder)
    with av.open(str(folder / f"video{ending}"), "w") as file:
        stream = file.add_stream(encoder, rate=RATE)
        stream.height, stream.width = log.pictures[0].shape
        stream.pix_fmt = "yuvj420p" if encoder == "mjpeg" else "yuv420p"
        for k, picture in enumerate(log.pictures):
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), format="bgr24")
            frame.pts, frame.time_base = k, Fraction(1, RATE)
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))


def judged(lumo, log, out):
    """(free frames, of them touched, of them with p > 0.9, frames from 5 N on, of them located, their error in mm)"""
    subprocess.run([lumo, "locate", log, "--out", out, "--quiet"], check=True, capture_output=True)
    truth = {r["stamp_ns"]: (float(r["y_mm"] or "nan"), float(r["force_N"])) for r in rows_of(log, "truth")}
    free = touched = sure = pressed = 0
    errors = []
    for row in rows_of(out, "locations"):
        y, force = truth[row["stamp_ns"]]
        count = int(row["contacts"])
        if force < 0.05:
            free += 1
            touched += count > 0
            sure += count > 0 and float(row["probability"]) > 0.9
        if force >= 5.0:
            pressed += 1
            if count == 1:
                errors.append(abs(float(row["y_mm"]) - y))
    return free, touched, sure, pressed, errors


def main(lumo, *folders):
    logs = [Log.read(folder, FROM_NS, math.inf, 1.0) for folder in folders]
    print("| pictures | free frames | touched | with p > 0.9 | from 5 N on | located | error mm |")
    print("|---|---|---|---|---|---|---|")
    wrong = 0
    ways = [(n, write_pictures, rest) for n, *rest in PICTURES] + [(n, write_video, rest) for n, *rest in VIDEOS]
    with tempfile.TemporaryDirectory() as scratch:
        for name, write, how in ways:
            counts, errors = np.zeros(4, int), []
            for log in logs:
                folder, out = pathlib.Path(scratch) / "log", pathlib.Path(scratch) / "out"
                write(log, folder, *how)
                *some, away = judged(lumo, folder, out)
                counts += some
                errors += away
                shutil.rmtree(folder)
                shutil.rmtree(out)
            free, touched, sure, pressed = counts
            wrong += sure
            print(f"| {name} | {free} | {touched} | {sure} | {pressed} | {len(errors)} | {np.mean(errors):.2f} |", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
