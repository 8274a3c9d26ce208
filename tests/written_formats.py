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

    def state(group, **values):
        for name, value in values.items():
            parameters[group][name]["value"] = value

    file = ezc3d.c3d()
    parameters = file["parameters"]
    state("POINT", RATE=[rate], LABELS=tuple(points), UNITS=["mm"])
    if angles:
        file.add_parameter("POINT", "ANGLES", list(angles))
        file.add_parameter("POINT", "ANGLE_UNITS", ["deg"])
    scaled = np.stack([x * (DEG if label in angles else 1e3) for label, x in points.items()], axis=1)
    file["data"]["points"] = np.concatenate([scaled, np.ones((*scaled.shape[:2], 1))], axis=2).T
    channels, units = dict(analog or {}), ["V"] * len(analog or {})
    if wrench is not None:
        whole("CHANNEL", range(len(channels) + 1, len(channels) + 7), [6, 1])
        whole("ZERO", [1, 0], [2])
        felt = plate_readings(wrench) * np.repeat([1, 1e3], 3)
        channels |= dict(zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), felt.T, strict=True))
        units += 3 * ["N"] + 3 * ["Nmm"]
        plate = {"USED": 1, "TYPE": 2, "CORNERS": 1e3 * PLATE[:, :, None], "ORIGIN": 1e3 * TOP[:, None]}
        for name, value in plate.items():
            file.add_parameter("FORCE_PLATFORM", name, value)
    if channels:
        values = np.stack(list(channels.values()))
        state("ANALOG", LABELS=tuple(channels), UNITS=units, SCALE=[1.0] * len(channels))
        state("ANALOG", RATE=[rate * values.shape[1] / len(scaled)])
        file["data"]["analogs"] = values[None]
    file.write(str(path))


def write_bag(path, topics, *, stamped=True, packed=False):
    """Writes a ROS 1 bag (`.bag`), or the folder of a ROS 2 bag, in MCAP if `mcap` is in its name."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    one = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    plugin = rosbag2.StoragePlugin.MCAP if "mcap" in path.name else rosbag2.StoragePlugin.SQLITE3
    writer = rosbag1.Writer(path) if one else rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if packed and one:
        writer.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
    elif packed:
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        for topic, (time, content) in topics.items():
            kind = "sensor_msgs/msg/JointState"
            if not isinstance(content, dict):
                kind = "geometry_msgs/msg/WrenchStamped" if content.shape[1] == 6 else "std_msgs/msg/Float64MultiArray"
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, t in enumerate(1_700_000_000_250_000_000 + np.round(1e9 * time).astype(np.int64)):
                message = _message(store.types, kind, content, i, int(t) if stamped else 0, {"seq": i} if one else {})
                data = store.serialize_ros1(message, kind) if one else store.serialize_cdr(message, kind)
                writer.write(connection, int(t) + 3_000_000, data)


def _message(types, kind, content, i, stamp, numbered):
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="tool", **numbered)
    if isinstance(content, dict):
        position, velocity, effort = np.array([c[i] for c in content.values()], float).T.copy()
        return types[kind](header=header, name=list(content), position=position, velocity=velocity, effort=effort)
    if content.shape[1] == 6:
        force, torque = (types["geometry_msgs/msg/Vector3"](*map(float, x)) for x in np.split(content[i], 2))
        return types[kind](header=header, wrench=types["geometry_msgs/msg/Wrench"](force=force, torque=torque))
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types[kind](layout=layout, data=np.array(content[i], float))


def write_lerobot(folder, episodes, version, names):
    """Writes a LeRobot dataset of `{number: {feature: (N,) or (N, d)}}` at 100 Hz, with names of some components."""
    import json

    import pyarrow
    import pyarrow.parquet

    def write(path, content):
        path.parent.mkdir(parents=True, exist_ok=True)
        pyarrow.parquet.write_table(content, path, row_group_size=64)

    def cells(x):
        return x if x.ndim == 1 else pyarrow.FixedSizeListArray.from_arrays(x.ravel(), x.shape[1])

    def feature(name, x):
        return {"dtype": "float32", "shape": list(x.shape[1:]) or [1], "names": names.get(name)}

    tables, places, index = [], [], 0
    for place, k in enumerate(sorted(episodes)):
        rows = len(next(iter(episodes[k].values())))
        counts = {name: np.full(rows, x) for name, x in (("frame_index", 0), ("task_index", 0), ("episode_index", k))}
        counts |= {"frame_index": np.arange(rows), "index": index + np.arange(rows)}
        columns = {name: cells(x) for name, x in episodes[k].items()}
        columns["timestamp"] = (np.arange(rows) / 100).astype(np.float32)
        tables.append(pyarrow.table(columns | counts))
        places.append({"episode_index": k, "data/chunk_index": 0, "data/file_index": place // 2, "length": rows})
        index += rows
        if version == 2:
            write(folder / f"data/chunk-000/episode_{k:06d}.parquet", tables[-1])
    features = {"observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "c"]}}
    features |= {name: feature(name, x) for each in episodes.values() for name, x in each.items()}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in counts}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    if version == 3:
        for k in range(0, len(tables), 2):
            write(folder / f"data/chunk-000/file-{k // 2:03d}.parquet", pyarrow.concat_tables(tables[k : k + 2]))
        write(folder / "meta/episodes/chunk-000/file-000.parquet", pyarrow.Table.from_pylist(places))
    (folder / "meta").mkdir(exist_ok=True)
    info = {"codebase_version": "v2.1" if version == 2 else "v3.0", "fps": 100, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
