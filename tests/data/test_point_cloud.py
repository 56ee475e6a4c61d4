"""PLY files of any program give their points and colours; what cannot be read is named."""

import struct
from pathlib import Path

import numpy as np
import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.point_cloud import distinct, read_cloud

XYZ = np.array([[4649776.25, 1.5, -2], [4649777.125, 3, 4], [4649778, -5, 6.75]])
RGB = np.array([[7, 8, 9], [200, 100, 50], [255, 0, 128]])

SIGNED = {"char": "b", "short": "h", "int": "i", "int8": "b", "int16": "h", "int32": "i"}
TYPES = SIGNED | {
    **{"uchar": "B", "ushort": "H", "uint": "I", "uint8": "B", "uint16": "H", "uint32": "I"},
    **{"float": "f", "double": "d", "float32": "f", "float64": "d"},
}
"""All names of the format, and what they are in Python's `struct`."""


def write(
    path: Path,
    columns: dict[str, tuple[str, np.ndarray]],
    kind: str = "binary_little_endian",
    before: str = "",
    behind: str = "",
    newline: str = "\n",
) -> Path:
    """A PLY by the format's description, with further lines of the header around the vertices."""
    count = len(next(iter(columns.values()))[1])
    head = [f"ply\nformat {kind} 1.0\ncomment von Bürö\n{before}element vertex {count}"]
    head += [f"property {type} {name}" for name, (type, _) in columns.items()]
    order = ">" if kind == "binary_big_endian" else "<"
    body = b""
    for row in zip(*(values for _, values in columns.values()), strict=True):
        for (type, _), value in zip(columns.values(), row, strict=True):
            value = float(value) if TYPES[type] in "fd" else int(value)
            body += (
                f"{value!r} ".encode()
                if kind == "ascii"
                else struct.pack(order + TYPES[type], value)
            )
        body += newline.encode() if kind == "ascii" else b""
    text = "\n".join(head) + f"\n{behind}end_header\n"
    path.write_bytes(text.replace("\n", newline).encode() + body)
    return path


def columns(type: str = "uchar", scale: float = 1, names: str = "red green blue") -> dict:
    places = {axis: ("double", XYZ[:, i]) for i, axis in enumerate("xyz")}
    return places | {n: (type, RGB[:, i] * scale) for i, n in enumerate(names.split())}


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("type", TYPES)
def test_every_type_of_the_format_is_read(tmp_path: Path, kind: str, type: str):
    table = columns(type)
    if type in ("char", "int8"):  # bytes that a program without uchar writes
        table |= {n: (t, (v + 128) % 256 - 128) for n, (t, v) in table.items() if n not in "xyz"}
    cloud = read_cloud(write(tmp_path / "a.ply", table, kind))
    np.testing.assert_array_equal(cloud.xyz, XYZ)
    np.testing.assert_array_equal(cloud.rgb, RGB)
    assert cloud.ids.tolist() == [1, 2, 3]


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize(
    ("table", "rgb"),
    [
        (columns("ushort", 257), RGB),
        (columns("float", 1 / 255), RGB),
        (columns(names="diffuse_red diffuse_green diffuse_blue"), RGB),
        (columns(names="R G B"), RGB),
        (dict(reversed([*columns().items(), ("alpha", ("uchar", RGB[:, 0]))])), RGB),
        (columns(names="not_red not_green not_blue"), 0 * RGB),
        ({name.upper(): column for name, column in columns().items()}, RGB),
    ],
    ids=["16 bits", "0 to 1", "diffuse", "r g b", "reversed, alpha", "no colours", "capitals"],
)
def test_colours_are_found_by_their_names_and_brought_to_8_bits(tmp_path, kind, table, rgb):
    cloud = read_cloud(write(tmp_path / "a.ply", table, kind))
    np.testing.assert_array_equal(cloud.xyz, XYZ)
    np.testing.assert_array_equal(cloud.rgb, rgb)


def test_a_few_colours_beyond_1_or_below_0_or_broken_change_no_other(tmp_path: Path):
    table = columns("float", 1 / 255)
    table["red"][1][:] = [np.nan, -1e-7, 300.0]
    cloud = read_cloud(write(tmp_path / "a.ply", table | {"red": table["red"]}))
    np.testing.assert_array_equal(cloud.rgb[:, 1:], RGB[:, 1:])


def test_splats_give_their_zeroth_harmonics(tmp_path: Path):
    """The constant harmonic is 1 / (2 sqrt(pi)), and the colour 1/2 more."""
    names = ["f_dc_0", "f_dc_1", "f_dc_2"]
    values = (RGB / 255 - 0.5) * 2 * np.sqrt(np.pi)
    table = columns(names="") | {n: ("float", values[:, i]) for i, n in enumerate(names)}
    np.testing.assert_array_equal(read_cloud(write(tmp_path / "a.ply", table)).rgb, RGB)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_faces_and_other_elements_are_passed_over(tmp_path: Path, kind: str, newline: str):
    """Those behind the vertices are not even looked at: the file ends before them."""
    before, behind = "", "element face 2\nproperty list uchar int vertex_indices\n"
    path = write(tmp_path / "a.ply", columns(), kind, before, behind, newline)
    np.testing.assert_array_equal(read_cloud(path).rgb, RGB)
    head, _, body = path.read_bytes().partition(f"end_header{newline}".encode())
    other = "element a 1\nproperty list uchar int b\nelement vertex".replace("\n", newline)
    head = head.replace(b"element vertex", other.encode())
    row = f"2 5 6{newline}".encode() if kind == "ascii" else struct.pack("<Bii", 2, 5, 6)
    path.write_bytes(head + f"end_header{newline}".encode() + row + body)
    np.testing.assert_array_equal(read_cloud(path).xyz, XYZ)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_vertices_with_lists_are_read(tmp_path: Path, kind: str):
    path = write(tmp_path / "a.ply", {n: c for n, c in columns().items() if n in "xyz"}, kind)
    head, mark, body = path.read_bytes().partition(b"end_header\n")
    rows = body.splitlines() if kind == "ascii" else [body[24 * i : 24 * i + 24] for i in range(3)]
    ends = [b"0\n", b"1 5\n", b"2 5 6\n"] if kind == "ascii" else [b"\0", b"\1\5", b"\2\5\6"]
    rows = b"".join(row + end for row, end in zip(rows, ends, strict=True))
    path.write_bytes(head + b"property list uchar uchar seen_by\n" + mark + rows)
    np.testing.assert_array_equal(read_cloud(path).xyz, XYZ)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_what_is_no_cloud_is_named(tmp_path: Path, kind: str):
    path = write(tmp_path / "a.ply", columns(), kind)
    content = path.read_bytes()
    flat = {name: column for name, column in columns().items() if name != "z"}
    damaged = [b"", b"solid", content[:50], content[:-20], content.replace(b"uchar", b"x")]
    damaged += [content.replace(b"vertex 3", b"vertex " + n) for n in (b"0", b"-3", 20 * b"9")]
    damaged += [write(tmp_path / "b.ply", flat, kind).read_bytes()]
    for bad in damaged:
        path.write_bytes(bad)
        with pytest.raises(CaptureError, match=r"a\.ply cannot be read"):
            read_cloud(path)
    path.unlink()
    with pytest.raises(CaptureError, match=r"a\.ply cannot be read"):
        read_cloud(path)


def test_of_points_at_one_place_the_first_stays():
    xyz = np.random.default_rng(0).normal(size=(100, 3))
    near = xyz + 1e-8  # a tenth of a step of float32; some lie across the border of a cell
    assert len(distinct(np.concatenate([xyz, near]))) < 110
    assert distinct(np.concatenate([xyz[:3], xyz])).tolist() == [0, 1, 2, *range(6, 103)]
    assert distinct(np.zeros((9, 3))).tolist() == [0] and len(distinct(np.zeros((0, 3)))) == 0
    apart = np.concatenate([xyz, 1e9 + xyz[:1], np.zeros((200, 3)) + xyz[0]])
    assert len(distinct(apart)) == 101, "neither one far away nor many at one place count"
