"""Logs of other programs, written by the libraries of their formats from named columns."""

import gzip

import numpy as np
from malformed_logs import text
from marked import trc

DEG = 180 / np.pi


def write_csv(path, columns, delimiter=","):
    content = text(columns, delimiter).encode()
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def write_mot(path, columns, degrees="yes"):
    rows = ["\t".join(repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)]
    head = ["Coordinates", "version=1", f"nRows={len(rows)}", f"nColumns={len(columns)}", f"inDegrees={degrees}"]
    path.write_text("\n".join([*head, "", "endheader", "\t".join(columns), *rows, ""]))


def write_trc(path, time, markers, unit="mm"):
    x = np.stack(list(markers.values()), axis=1)
    path.write_text(trc(time, list(markers), x, unit, {"mm": 1e3, "m": 1.0}[unit]))


def write_mat(path, columns, **others):
    from scipy.io import savemat

    savemat(path, {name: np.asarray(x)[:, None] for name, x in columns.items()} | others, do_compression=True)


def write_parquet(path, columns):
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)


PLATE = np.array([[0.7, 0.1, 0], [0.1, 0.1, 0], [0.1, 0.5, 0], [0.7, 0.5, 0]]).T
"""Corners of a force plate whose z-axis points down, m (3, 4)."""

TOP = np.array([0.01, -0.02, -0.04])
"""Position of the middle of the plate's top from its transducer, in the plate's axes, m."""


def plate_readings(wrench):
    """Readings (N, 6) of a plate at `PLATE` for wrenches in the laboratory's axes about its origin (N, 6)."""
    down = np.diag([1.0, -1.0, -1.0])
    force, torque = wrench[:, :3] @ down, (wrench[:, 3:] - np.cross(PLATE.mean(axis=1), wrench[:, :3])) @ down
    return np.hstack([force, torque - np.cross(force, TOP)])


def write_c3d(path, rate, points, wrench=None, angles=(), analog=None):
    """Writes points (N, 3) in m, angles in rad, a platform with wrenches (k N, 6), and analog channels (k N,) in V."""
    import ezc3d

    def whole(name, values, shape):
        parameter = ezc3d.ezc3d.Parameter(name)
        parameter.set(list(values), shape)
        parameters.add_parameter("FORCE_PLATFORM", parameter)
        parameters["FORCE_PLATFORM"][name]["type"] = 2

    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [rate]
    parameters["POINT"]["LABELS"]["value"] = tuple(points)
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    if angles:
        file.add_parameter("POINT", "ANGLES", list(angles))
        file.add_parameter("POINT", "ANGLE_UNITS", ["deg"])
    scaled = [x * (DEG if label in angles else 1e3) for label, x in points.items()]
    file["data"]["points"] = np.concatenate([np.stack(scaled, 1), np.ones((len(scaled[0]), len(scaled), 1))], 2).T
    channels = dict(analog or {})
    if wrench is not None:
        felt = plate_readings(wrench) * np.r_[1, 1, 1, 1e3, 1e3, 1e3]
        channels |= dict(zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), felt.T, strict=True))
        file.add_parameter("FORCE_PLATFORM", "USED", 1)
        file.add_parameter("FORCE_PLATFORM", "TYPE", 2)
        whole("ZERO", [1, 0], [2])
        file.add_parameter("FORCE_PLATFORM", "CORNERS", 1e3 * PLATE[:, :, None])
        file.add_parameter("FORCE_PLATFORM", "ORIGIN", 1e3 * TOP[:, None])
        first = len(channels) - 6
        whole("CHANNEL", range(first + 1, first + 7), [6, 1])
    if channels:
        samples = len(next(iter(channels.values())))
        parameters["ANALOG"]["RATE"]["value"] = [rate * samples / len(scaled[0])]
        parameters["ANALOG"]["LABELS"]["value"] = tuple(channels)
        units = {"F": "N", "M": "Nmm"}
        parameters["ANALOG"]["UNITS"]["value"] = [units.get(x[0], "V") if len(x) == 2 else "V" for x in channels]
        parameters["ANALOG"]["SCALE"]["value"] = [1.0] * len(channels)
        file["data"]["analogs"] = np.stack(list(channels.values()))[None]
    file.write(str(path))


def write_bag(path, topics, *, stamped=True, packed=False, mode="STORAGE"):
    """Writes a ROS 1 bag (`.bag`), or the folder of a ROS 2 bag, in MCAP if `mcap` is in its name."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat as Format
    from rosbags.rosbag2 import CompressionMode as Mode
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    one = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if "mcap" in path.name else StoragePlugin.SQLITE3
    writer = Writer1(path) if one else Writer2(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(*([Writer1.CompressionFormat.BZ2] if one else [Mode[mode], Format.ZSTD]))
    with writer:
        for topic, (time, content) in topics.items():
            kind = "sensor_msgs/msg/JointState" if isinstance(content, dict) else "geometry_msgs/msg/WrenchStamped"
            kind = kind if isinstance(content, dict) or content.shape[1] == 6 else "std_msgs/msg/Float64MultiArray"
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, t in enumerate(1_700_000_000_250_000_000 + np.round(1e9 * time).astype(np.int64)):
                message = _message(store, kind, content, i, int(t) if stamped else 0, one)
                data = store.serialize_ros1(message, kind) if one else store.serialize_cdr(message, kind)
                writer.write(connection, int(t) + 3_000_000, data)


def _message(store, kind, content, i, stamp, one):
    types = store.types
    sec, nanosec = divmod(stamp, 10**9)
    time = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="tool", **({"seq": i} if one else {}))
    if isinstance(content, dict):
        position, velocity, effort = (np.array(x, float) for x in zip(*(c[i] for c in content.values()), strict=True))
        return types[kind](header=header, name=list(content), position=position, velocity=velocity, effort=effort)
    if content.shape[1] == 6:
        force, torque = (types["geometry_msgs/msg/Vector3"](*map(float, x)) for x in np.split(content[i], 2))
        return types[kind](header=header, wrench=types["geometry_msgs/msg/Wrench"](force=force, torque=torque))
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types[kind](layout=layout, data=np.array(content[i], float))


def write_lerobot(folder, episodes, version=3, names=None, fps=100, together=2):
    """Writes a LeRobot dataset of `{number: {feature: (N,) or (N, d)}}`, some with names of their components."""
    import json

    import pyarrow
    import pyarrow.parquet

    numbers = sorted(episodes)
    together = 1 if version == 2 else together
    files = [numbers[i : i + together] for i in range(0, len(numbers), together)]
    places, index = [], 0
    features = {"observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "c"]}}
    for at, those in enumerate(files):
        parts = []
        for k in those:
            features |= {name: _feature(x, (names or {}).get(name)) for name, x in episodes[k].items()}
            columns, rows = {name: _cells(x) for name, x in episodes[k].items()}, len(next(iter(episodes[k].values())))
            counts = {"frame_index": np.arange(rows), "task_index": np.zeros(rows, int)}
            counts["episode_index"] = np.full(rows, k)
            times = {"timestamp": (np.arange(rows) / fps).astype(np.float32)}
            parts.append(pyarrow.table({**columns, **times, **counts, "index": index + np.arange(rows)}))
            places.append({"episode_index": k, "data/chunk_index": 0, "data/file_index": at, "length": rows})
            index += rows
        name = f"episode_{those[0]:06d}.parquet" if version == 2 else f"file-{at:03d}.parquet"
        path = folder / "data/chunk-000" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        pyarrow.parquet.write_table(pyarrow.concat_tables(parts), path, row_group_size=64)
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in counts}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    (folder / "meta").mkdir()
    info = {"codebase_version": "v2.1" if version == 2 else "v3.0", "fps": fps, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    if version == 3:
        (folder / "meta/episodes/chunk-000").mkdir(parents=True)
        listed = pyarrow.Table.from_pylist(places)
        pyarrow.parquet.write_table(listed, folder / "meta/episodes/chunk-000/file-000.parquet")


def _feature(x, names):
    return {"dtype": "float32", "shape": [1 if x.ndim == 1 else x.shape[1]], "names": names}


def _cells(x):
    import pyarrow

    return pyarrow.array(x) if x.ndim == 1 else pyarrow.FixedSizeListArray.from_arrays(x.ravel(), x.shape[1])
