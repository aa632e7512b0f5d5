"""MCAP files between lumo and the Python packages mcap and mcap-ros2-support: each reads what the other wrote, with
equal contents.

usage: test_mcap.py path/to/lumo          (with the packages of tests/sense/requirements.txt; see tests/run)
"""

import csv
import io
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

import mcap.reader
import mcap.stream_reader
import mcap.writer
import mcap_ros2.decoder
import mcap_ros2.writer
import zstandard

from refusal import check_refusal

LUMO = ""
USAGE, BAD_FILE = 2, 5
WIDTH, HEIGHT, FRAMES = 6, 4, 5
START_NS = 1_700_000_000_000_000_001
TOPICS = {
    "/camera/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/exposure": "lumo_msgs/msg/FrameExposure",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_currents": "lumo_msgs/msg/JointCurrents",
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/marker": "lumo_msgs/msg/MarkerDisplacement",
    "/photodiodes": "lumo_msgs/msg/PhotodiodeSignals",
}


def run(*arguments):
    return subprocess.run(
        [LUMO, *map(str, arguments)], capture_output=True, text=True, timeout=300, env=dict(os.environ, LC_ALL="C")
    )


def pixels(k):
    """Red, green, blue of a picture, row by row."""
    return [
        [((40 * k + 7 * x) % 256, (11 * y + k) % 256, (x * y + 3 * k) % 256) for x in range(WIDTH)]
        for y in range(HEIGHT)
    ]


def png(rows):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    raw = b"".join(b"\0" + bytes(v for pixel in row for v in pixel) for row in rows)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 2, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(raw))
        + chunk(b"IEND", b"")
    )


def rows_of(path):
    with open(path, newline="") as table:
        return [
            {k: v if k == "file" else float(v) if k != "stamp_ns" else int(v) for k, v in row.items()}
            for row in csv.DictReader(table)
        ]


def tables_of(folder):
    return {p.name: rows_of(p) for p in sorted(folder.glob("*.csv"))}


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def stamp(ns):
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def write_folder(folder):
    (folder / "frames").mkdir(parents=True)
    (folder / "session.json").write_text(
        json.dumps(
            {
                "format": "lumo-log",
                "version": 1,
                "title": "µ",
                "torque_constant_Nm_per_A": [0.9, 1.1],
                "joint_clock": {"offset_s": 12.5},
                "segments": [{"from_ns": 1, "to_ns": 2, "kind": "hold", "place": 3, "y_mm": 5.5}],
            }
        )
    )
    stamps = [START_NS + 33_333_333 * k for k in range(FRAMES)]
    for k in range(FRAMES):
        (folder / "frames" / f"{k:06}.png").write_bytes(png(pixels(k)))

    def table(name, header, rows):
        (folder / name).write_text(
            "\n".join([header, *(",".join(map(repr, row)).replace("'", "") for row in rows)]) + "\n"
        )

    table(
        "frames.csv",
        "stamp_ns,file,exposure_s,gain",
        [(t, f"{k:06}.png", 0.001 * (k + 1), 64.5) for k, t in enumerate(stamps)],
    )
    table(
        "joint.csv",
        "stamp_ns,position_rad_0,velocity_rad_per_s_0,current_A_0,position_rad_1,velocity_rad_per_s_1,current_A_1",
        [
            (t - 12_500_000_000 + 1_000_003 * j, 0.1 * k, 1 / 3, -0.25 * j, 1e-300, float(k), 7.0)
            for k, t in enumerate(stamps)
            for j in range(4)
        ],
    )
    table(
        "wrench.csv",
        "stamp_ns,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm",
        [(t + 5, 0.1, 0.2, -1.5 * k, 1e-9, 0.0, float(k)) for k, t in enumerate(stamps)],
    )
    table("marker.csv", "stamp_ns,displacement_m", [(t, 1e-4 * k) for k, t in enumerate(stamps)])
    table("photodiode.csv", "stamp_ns,signal_V_0,signal_V_1", [(t, 0.5, 0.25 * k) for k, t in enumerate(stamps)])


class Mcap(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = pathlib.Path(tempfile.mkdtemp())
        cls.folder = cls.scratch / "log"
        write_folder(cls.folder)
        definitions = cls.scratch / "definitions.mcap"
        cls.converted(cls.folder, definitions, "--raw")
        with open(definitions, "rb") as file:  # texts of types, for files that Python writes
            cls.definitions = {
                s.name: s.data.decode() for s in mcap.reader.make_reader(file).get_summary().schemas.values()
            }
        with open(cls.mcap_of("zstd"), "rb") as file:
            cls.definitions.update(
                {s.name: s.data.decode() for s in mcap.reader.make_reader(file).get_summary().schemas.values()}
            )

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.scratch)

    @classmethod
    def converted(cls, source, target, *options):
        done = run("convert", source, target, "--json", "--quiet", *options)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    @classmethod
    def mcap_of(cls, compression, *options):
        path = cls.scratch / f"{compression}{''.join(options)}.mcap"
        if not path.exists():
            cls.converted(cls.folder, path, "--compression", compression, *options)
        return path

    def refused(self, code, words, *arguments):
        check_refusal(self, run(*arguments), code, words)

    def messages(self, path):
        with open(path, "rb") as file:
            reader = mcap.reader.make_reader(
                file, validate_crcs=True, decoder_factories=[mcap_ros2.decoder.DecoderFactory()]
            )
            found = {}
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                self.assertEqual(schema.encoding, "ros2msg")
                self.assertEqual(channel.message_encoding, "cdr")
                found.setdefault(channel.topic, []).append((schema.name, message.log_time, decoded))
            return found, reader

    def test_python_reads_what_lumo_wrote(self):
        tables = tables_of(self.folder)
        for compression in ["zstd", "lz4", "none"]:
            with self.subTest(compression):
                path = self.mcap_of(compression)
                found, _ = self.messages(path)
                self.assertEqual({topic: m[0][0] for topic, m in found.items()}, TOPICS)
                for k, (_, log_time, m) in enumerate(found["/camera/image/compressed"]):
                    self.assertEqual((bytes(m.data), m.format), (png(pixels(k)), "png"))
                    self.assertEqual(log_time, stamp_of(m))
                    self.assertEqual(stamp_of(m), tables["frames.csv"][k]["stamp_ns"])
                self.assertEqual({(m.width, m.height) for _, _, m in found["/camera/camera_info"]}, {(WIDTH, HEIGHT)})
                self.assertEqual(
                    [(m.exposure_s, m.gain) for _, _, m in found["/camera/exposure"]],
                    [(r["exposure_s"], r["gain"]) for r in tables["frames.csv"]],
                )
                for (_, log_time, m), (_, _, c), row in zip(
                    found["/joint_states"], found["/joint_currents"], tables["joint.csv"], strict=True
                ):
                    self.assertEqual((m.name, m.effort), (["joint_0", "joint_1"], []))
                    self.assertEqual(log_time, stamp_of(m) + 12_500_000_000)  # on the frames' clock
                    self.assertEqual(
                        [stamp_of(c), *m.position, *m.velocity, *c.current_a],
                        [
                            row[k]
                            for k in [
                                "stamp_ns",
                                "position_rad_0",
                                "position_rad_1",
                                "velocity_rad_per_s_0",
                                "velocity_rad_per_s_1",
                                "current_A_0",
                                "current_A_1",
                            ]
                        ],
                    )
                self.assertEqual(
                    [
                        [stamp_of(m), *(getattr(v, a) for v in (m.wrench.force, m.wrench.torque) for a in "xyz")]
                        for _, _, m in found["/wrench"]
                    ],
                    [list(r.values()) for r in tables["wrench.csv"]],
                )
                self.assertEqual(
                    [[stamp_of(m), m.displacement_m] for _, _, m in found["/marker"]],
                    [list(r.values()) for r in tables["marker.csv"]],
                )
                self.assertEqual(
                    [[stamp_of(m), *m.signal_v] for _, _, m in found["/photodiodes"]],
                    [list(r.values()) for r in tables["photodiode.csv"]],
                )

    def test_python_finds_its_way(self):
        for compression in ["zstd", "lz4", "none"]:
            path = self.mcap_of(compression)
            with open(path, "rb") as file:
                reader = mcap.reader.make_reader(file, validate_crcs=True)
                self.assertEqual(reader.get_header().profile, "ros2")
                summary = reader.get_summary()
                count = len(list(reader.iter_messages()))
                self.assertEqual(summary.statistics.message_count, count)
                self.assertEqual(sum(summary.statistics.channel_message_counts.values()), count)
                self.assertEqual(len(summary.chunk_indexes), summary.statistics.chunk_count)
                self.assertEqual(
                    {c.compression for c in summary.chunk_indexes}, {"" if compression == "none" else compression}
                )
                late = START_NS + 33_333_333 * (FRAMES - 1)  # by the index
                self.assertEqual(
                    len(list(reader.iter_messages(topics=["/camera/image/compressed"], starting_at=late))), 1
                )
                (attached,) = reader.iter_attachments()
                self.assertEqual((attached.name, attached.media_type), ("session.json", "application/json"))
                self.assertEqual(json.loads(attached.data)["title"], "µ")
            with open(path, "rb") as file:  # record by record: checksums of the data and of chunks
                self.assertGreater(len(list(mcap.stream_reader.StreamReader(file, validate_crcs=True).records)), count)
            whole = path.read_bytes()
            summary_start, _, summary_crc = struct.unpack("<QQI", whole[-28:-8])
            self.assertEqual(zlib.crc32(whole[summary_start:-12]), summary_crc)

    def test_pixels(self):
        found, _ = self.messages(self.mcap_of("zstd", "--raw"))
        for k, (kind, _, m) in enumerate(found["/camera/image"]):
            self.assertEqual(
                (kind, m.encoding, m.width, m.height, m.step),
                ("sensor_msgs/msg/Image", "bgr8", WIDTH, HEIGHT, 3 * WIDTH),
            )
            self.assertEqual(bytes(m.data), bytes(v for row in pixels(k) for r, g, b in row for v in (b, g, r)))

    def test_there_and_back(self):
        for options in [("zstd",), ("lz4",), ("none",), ("zstd", "--raw")]:
            with self.subTest(options):
                back = self.scratch / f"back{''.join(options)}"
                result = self.converted(self.mcap_of(*options), back)
                self.assertEqual(
                    (result["frames"], result["joint_samples"], result["fault"]), (FRAMES, 4 * FRAMES, None)
                )
                self.assertEqual(tables_of(back), tables_of(self.folder))
                again = self.scratch / f"again{''.join(options)}.mcap"  # written sessions have all keys
                self.converted(back, again, "--compression", options[0], *options[1:])
                self.assertEqual(again.read_bytes(), self.mcap_of(*options).read_bytes())
                if "--raw" not in options:
                    for k in range(FRAMES):
                        self.assertEqual((back / "frames" / f"{k:06}.png").read_bytes(), png(pixels(k)))

    def write_by_python(self, path, compression, raw, frames=range(FRAMES), **options):
        """As a ROS 2 bag with a camera that gives red first, and a joint whose effort is a torque."""
        writer = mcap_ros2.writer.Writer(
            io.BytesIO()
        )  # which knows the messages; what it writes them with has more options
        file = open(path, "wb")
        self.addCleanup(file.close)
        writer._writer = mcap.writer.Writer(file, compression=compression, **options)
        writer._writer.start(profile="ros2", library="test")
        kind = "sensor_msgs/msg/Image" if raw else "sensor_msgs/msg/CompressedImage"
        schemas = {
            name: writer.register_msgdef(name, self.definitions[name])
            for name in [
                kind,
                "sensor_msgs/msg/JointState",
                "geometry_msgs/msg/WrenchStamped",
                "sensor_msgs/msg/CameraInfo",
            ]
        }
        for k in frames:
            t = START_NS + 33_333_333 * k
            header = {"stamp": stamp(t), "frame_id": "c"}
            picture = {
                "header": header,
                "height": HEIGHT,
                "width": WIDTH,
                "encoding": "rgb8",
                "is_bigendian": 0,
                "step": 3 * WIDTH,
                "data": bytes(v for row in pixels(k) for p in row for v in p),
            }
            if not raw:
                picture = {"header": header, "format": "rgb8; png compressed", "data": png(pixels(k))}
            writer.write_message("/cam", schemas[kind], picture, log_time=t + 7, publish_time=t)
            writer.write_message(
                "/js",
                schemas["sensor_msgs/msg/JointState"],
                {
                    "header": header,
                    "name": ["finger"],
                    "position": [0.1 * k],
                    "velocity": [1 / 3],
                    "effort": [-0.5 * k],
                },
                log_time=t - 9,
            )
            vector = {"x": 0.1, "y": 0.2, "z": -1.5 * k}
            writer.write_message(
                "/ft",
                schemas["geometry_msgs/msg/WrenchStamped"],
                {"header": header, "wrench": {"force": vector, "torque": {"x": 0.0, "y": 1e-9, "z": 3.0}}},
                log_time=t,
            )
            writer.write_message(
                "/cam/info",
                schemas["sensor_msgs/msg/CameraInfo"],
                {
                    "header": header,
                    "height": HEIGHT,
                    "width": WIDTH,
                    "distortion_model": "plumb_bob",
                    "d": [0.1] * 5,
                    "k": [1.0] * 9,
                    "r": [0.0] * 9,
                    "p": [2.0] * 12,
                    "binning_x": 0,
                    "binning_y": 0,
                    "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
                },
                log_time=t,
            )
        writer.finish()
        file.close()

    def bag(self, name, parts, metadata=True, pack=None):
        """A folder as `ros2 bag record` leaves it; `pack` makes the bytes of each file."""
        folder = self.scratch / name
        folder.mkdir()
        files = []
        for n, frames in enumerate(parts):
            path = folder / f"{name}_{n}.mcap"
            self.write_by_python(path, mcap.writer.CompressionType.ZSTD, True, frames=frames)
            if pack:
                packed = path.with_name(path.name + ".zstd")
                packed.write_bytes(pack(path.read_bytes()))
                path.unlink()
                path = packed
            files.append(path.name)
        if metadata:
            (folder / "metadata.yaml").write_text(
                "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  relative_file_paths:\n"
                + "".join(f"    - {f}\n" for f in files)
                + "  message_count: 20\n  compression_format: ''\n  compression_mode: ''\n"
            )
        return folder

    def test_a_bags_folder_is_one_log(self):
        whole = self.scratch / "whole.mcap"
        self.write_by_python(whole, mcap.writer.CompressionType.ZSTD, True)
        expected = self.scratch / "of_whole"
        self.converted(whole, expected)
        bags = {
            "split": {},
            "no_metadata": {"metadata": False},
            "packed": {"pack": zstandard.ZstdCompressor().compress},
        }
        for name, options in bags.items():
            with self.subTest(name):
                back = self.scratch / f"of_{name}"
                folder = self.bag(name, [range(3), range(3, FRAMES)], **options)
                result = self.converted(folder, back)
                self.assertEqual((result["frames"], result["pictures"], result["fault"]), (FRAMES, FRAMES, None))
                self.assertEqual(tables_of(back), tables_of(expected))
                for k in range(FRAMES):
                    file = f"{k:06}.png"
                    self.assertEqual((back / "frames" / file).read_bytes(), (expected / "frames" / file).read_bytes())
        described = self.scratch / "split" / "session.json"
        described.write_text('{"format": "lumo-log", "version": 1, "title": "by hand"}')
        self.converted(self.scratch / "split", self.scratch / "of_described")
        self.assertEqual(json.loads((self.scratch / "of_described" / "session.json").read_text())["title"], "by hand")
        (self.scratch / "split" / "split_1.mcap").unlink()
        self.refused(
            BAD_FILE, ["metadata.yaml", "'split_1.mcap' is missing"], "convert", self.scratch / "split", "x", "--quiet"
        )

    def test_other_containers_are_named(self):
        for begins, words in [
            (b"#ROSBAG V2.0\n" + bytes(99), ["bag of ROS 1", "rosbags-convert"]),
            (b"SQLite format 3\0" + bytes(99), ["SQLite", "ros2 bag convert"]),
            (b'{"topics": []}', ["is JSON"]),
        ]:
            path = self.scratch / "other_container"
            path.write_bytes(begins)
            self.refused(BAD_FILE, ["other_container", *words], "locate", path, "--quiet")
        path = self.scratch / "foxglove.mcap"
        with open(path, "wb") as file:
            writer = mcap.writer.Writer(file)
            writer.start()
            schema = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
            channel = writer.register_channel("/camera", "json", schema)
            writer.add_message(channel, START_NS, b"{}", START_NS)
            writer.finish()
        self.refused(
            BAD_FILE, ["no pictures", "/camera (foxglove.CompressedImage, json)"], "locate", path, "--quiet"
        )

    def write_pictures(self, path, name, pictures):
        writer = mcap_ros2.writer.Writer(str(path))
        kind = "sensor_msgs/msg/CompressedImage"
        schema = writer.register_msgdef(kind, self.definitions[kind])
        for k, data in enumerate(pictures):
            t = START_NS + 33_333_333 * k
            message = {"header": {"stamp": stamp(t), "frame_id": "c"}, "format": name, "data": data}
            writer.write_message("/cam", schema, message, log_time=t, publish_time=t)
        writer.finish()

    def test_convert_counts_pictures_or_fails(self):
        path = self.scratch / "pictures.mcap"
        self.write_pictures(path, "h264", [b"\0\0\0\1\x65" + bytes(range(200))] * 3)
        for target in ["of_h264", "of_h264.mcap"]:
            self.refused(BAD_FILE, ["'h264'", "PNG, JPEG"], "convert", path, self.scratch / target, "--quiet")
            self.assertFalse((self.scratch / target).exists())
        self.write_pictures(path, "png", [b"no picture"] * 3)
        self.refused(
            BAD_FILE, ["none of its 3 pictures", "3 damaged"], "convert", path, self.scratch / "of_none", "--quiet"
        )
        self.assertFalse((self.scratch / "of_none").exists())
        self.write_pictures(path, "png", [png(pixels(0)), b"no picture", b"", png(pixels(3))])
        done = run("convert", path, self.scratch / "of_some")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("2 pictures of 4 (1 missing, 1 damaged)", done.stdout)
        self.assertIn("of 4 pictures 1 missing, 1 damaged", done.stderr)
        self.assertEqual(len(list((self.scratch / "of_some" / "frames").iterdir())), 2)

    def test_joints_are_chosen_by_name(self):
        path = self.scratch / "joints.mcap"
        writer = mcap_ros2.writer.Writer(str(path))
        kind = "sensor_msgs/msg/JointState"
        schema = writer.register_msgdef(kind, self.definitions[kind])
        for k in range(4):
            t = START_NS + 4_000_000 * k
            for names, shift in [(["tip", "base"], 0), (["arm_0", "arm_1", "arm_2"], 1_000_000)]:
                values = [10.0 * k + n for n in range(len(names))]
                message = {"header": {"stamp": stamp(t + shift), "frame_id": ""}, "name": names, "position": values}
                message |= {"velocity": [], "effort": values}
                writer.write_message("/joint_states", schema, message, log_time=t + shift, publish_time=t)
        writer.finish()
        self.refused(
            BAD_FILE,
            ["chosen by their names", "arm_0, arm_1, arm_2", "tip, base"],
            "convert",
            path,
            self.scratch / "of_joints",
            "--quiet",
        )
        done = run("convert", path, self.scratch / "of_joints", "--joint-names", "base,tip")
        self.assertEqual(done.returncode, 0, done.stderr)
        chain = [(10.0 * k + 1, 10.0 * k) for k in range(4)]
        rows = rows_of(self.scratch / "of_joints" / "joint.csv")
        self.assertEqual([(r["torque_Nm_base"], r["torque_Nm_tip"]) for r in rows], chain)
        session = json.loads((self.scratch / "of_joints" / "session.json").read_text())
        self.assertEqual(session["joint_names"], ["base", "tip"])
        again = self.scratch / "joints_again.mcap"  # the order stays with the log, and another may be chosen
        self.assertEqual(self.converted(self.scratch / "of_joints", again)["joint_names"], ["base", "tip"])
        self.assertEqual(
            self.converted(again, self.scratch / "of_again", "--joint-names", "tip,base")["joint_names"], ["tip", "base"]
        )
        rows = rows_of(self.scratch / "of_again" / "joint.csv")
        self.assertEqual([(r["torque_Nm_base"], r["torque_Nm_tip"]) for r in rows], chain)
        self.refused(
            BAD_FILE,
            ["has no joint 'toe', but base, tip"],
            "convert",
            self.scratch / "of_joints",
            "x",
            "--joint-names",
            "toe",
            "--quiet",
        )
        self.refused(BAD_FILE, ["base, toe"], "convert", path, "x", "--joint-names", "base,toe", "--quiet")
        self.refused(USAGE, ["--joint-names is 'base,'"], "convert", path, "x", "--joint-names", "base,")

    def test_doctor_looks_at_a_log(self):
        done = run("doctor", self.folder, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        r = json.loads(done.stdout)
        self.assertEqual(r["pictures"], {"rows": FRAMES, "read": FRAMES, "missing": 0, "damaged": 0, "other_size": 0})
        self.assertEqual((r["width_px"], r["height_px"], r["joints"], r["segments"]), (WIDTH, HEIGHT, 2, 1))
        joints = r["streams"]["joint_states"]
        self.assertEqual((joints["rows"], joints["from_ns"], joints["fault"]), (4 * FRAMES, START_NS, None))
        self.assertFalse(r["unloaded"]["stated"])
        text = run("doctor", self.mcap_of("zstd")).stdout
        self.assertIn(f"pictures      {FRAMES}, 1700000000.000 to 1700000000.133 s", text)
        self.assertIn("joint states  20", text)
        self.refused(USAGE, ["LOG and --camera"], "doctor", self.folder, "--camera", "63")

    def test_lumo_reads_what_python_wrote(self):
        kinds = mcap.writer.CompressionType
        cases = [
            (kinds.ZSTD, {}),
            (kinds.LZ4, {}),
            (kinds.NONE, {}),
            (kinds.ZSTD, {"chunk_size": 200}),
            (kinds.LZ4, {"chunk_size": 1000}),
            (kinds.NONE, {"use_chunking": False}),
            (kinds.NONE, {"use_chunking": False, "enable_data_crcs": True}),
            (kinds.ZSTD, {"enable_data_crcs": True}),
            (kinds.LZ4, {"enable_crcs": False}),
            (
                kinds.ZSTD,
                {
                    "index_types": mcap.writer.IndexType.NONE,
                    "repeat_channels": False,
                    "repeat_schemas": False,
                    "use_statistics": False,
                    "use_summary_offsets": False,
                },
            ),
        ]
        for number, (compression, options) in enumerate(cases):
            for raw in [False, True]:
                with self.subTest(compression=compression, raw=raw, **options):
                    path, back = self.scratch / f"python{number}{raw}.mcap", self.scratch / f"python{number}{raw}"
                    self.write_by_python(path, compression, raw, **options)
                    result = self.converted(path, back)
                    self.assertEqual(
                        (result["frames"], result["joint_samples"], result["wrench_samples"], result["fault"]),
                        (FRAMES, FRAMES, FRAMES, None),
                    )
                    stamps = [START_NS + 33_333_333 * k for k in range(FRAMES)]
                    tables = tables_of(back)
                    self.assertEqual(
                        [list(r.values()) for r in tables["joint.csv"]],
                        [[t, 0.1 * k, 1 / 3, -0.5 * k] for k, t in enumerate(stamps)],
                    )
                    self.assertIn("torque_Nm_finger", tables["joint.csv"][0])
                    self.assertEqual(
                        [list(r.values()) for r in tables["wrench.csv"]],
                        [[t, 0.1, 0.2, -1.5 * k, 0.0, 1e-9, 3.0] for k, t in enumerate(stamps)],
                    )
                    self.assertEqual([r["stamp_ns"] for r in tables["frames.csv"]], stamps)
                    if raw:  # what became of the pixels, in a file again
                        again = self.scratch / f"pixels{number}.mcap"
                        self.converted(back, again, "--raw")
                        found, _ = self.messages(again)
                        self.assertEqual(
                            bytes(found["/camera/image"][2][2].data),
                            bytes(v for row in pixels(2) for r, g, b in row for v in (b, g, r)),
                        )
                    else:
                        self.assertEqual((back / "frames" / "000002.png").read_bytes(), png(pixels(2)))

    def test_cut_and_damaged(self):
        whole = self.mcap_of("none").read_bytes()
        cut, damaged = self.scratch / "cut.mcap", self.scratch / "damaged.mcap"
        cut.write_bytes(whole[:-300])
        result = self.converted(cut, self.scratch / "of_cut")
        self.assertIn("cut.mcap: byte ", result["fault"])
        done = run("convert", cut, self.scratch / "of_cut_again")
        self.assertIn("read up to there", done.stderr)
        damaged.write_bytes(whole[:2000] + bytes([whole[2000] ^ 4]) + whole[2001:])
        self.refused(
            BAD_FILE, ["damaged.mcap: byte ", "damaged"], "convert", damaged, self.scratch / "of_damaged", "--quiet"
        )
        self.assertFalse((self.scratch / "of_damaged").exists())
        other = self.scratch / "other.mcap"
        other.write_bytes(b"another kind of file")
        for command in ["decode", "metrics", "locate", "force", "calibrate"]:
            self.refused(BAD_FILE, ["is no MCAP file"], command, other, "--quiet")

    def test_refusals(self):
        self.refused(USAGE, ["log is missing"], "convert")
        self.refused(USAGE, ["to write is missing"], "convert", self.folder)
        self.refused(USAGE, ["--compression"], "convert", self.folder, self.scratch / "x.mcap", "--compression", "best")
        self.refused(BAD_FILE, ["it is there"], "convert", self.folder, self.mcap_of("zstd"), "--quiet")
        self.refused(BAD_FILE, ["not empty"], "convert", self.mcap_of("zstd"), self.folder, "--quiet")
        self.refused(
            BAD_FILE, ["cannot write"], "convert", self.folder, self.scratch / "no" / "such" / "x.mcap", "--quiet"
        )
        self.refused(
            BAD_FILE,
            ["no pictures on topic '/x'"],
            "convert",
            self.mcap_of("zstd"),
            self.scratch / "x",
            "--quiet",
            "--image-topic",
            "/x",
        )
        self.assertEqual([p for p in self.scratch.iterdir() if ".part" in p.name], [])


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
