import contextlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from pypcd4 import Encoding, PointCloud

from shared.cloud_files import read_cloud, scan_files, unit_warning, write_cloud, write_scan
from shared.errors import CloudFileError, InputFileError
from shared.messaging.messages import LidarScan

RNG = np.random.default_rng(7)
POINTS = RNG.uniform(-20, 20, (50, 3)).astype(np.float32).astype(np.float64)
COLOURS = RNG.integers(0, 256, (50, 3), dtype=np.uint8)
HEADER = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"
TWO = HEADER + "1 2 3\n4 5 6\n"


@pytest.mark.parametrize(("suffix", "tolerance_m"), [(".pcd", 0.0), (".ply", 0.0), (".las", 5.001e-6)])
@pytest.mark.parametrize("colours", [None, COLOURS])
def test_what_is_written_is_read(tmp_path, suffix, tolerance_m, colours):
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, POINTS, colours)
    read = read_cloud(path)
    assert read.points_m.dtype == np.float64
    np.testing.assert_allclose(read.points_m, POINTS, rtol=0, atol=tolerance_m)


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".las"])
def test_a_cloud_may_be_empty(tmp_path, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", np.empty((0, 3)))
    assert read_cloud(tmp_path / f"cloud{suffix}").points_m.shape == (0, 3)


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
def test_points_may_be_nan(tmp_path, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", np.full((3, 3), np.nan))
    assert np.isnan(read_cloud(tmp_path / f"cloud{suffix}").points_m).all()


def test_colours_are_as_other_readers_want_them(tmp_path):
    import open3d as o3d

    for suffix in (".pcd", ".ply"):
        write_cloud(tmp_path / f"cloud{suffix}", POINTS, COLOURS)
        cloud = o3d.io.read_point_cloud(str(tmp_path / f"cloud{suffix}"))
        np.testing.assert_allclose(np.asarray(cloud.points), POINTS, atol=1e-6)
        np.testing.assert_allclose(np.asarray(cloud.colors) * 255, COLOURS, atol=0.5)


@pytest.mark.parametrize("encoding", list(Encoding)[:3])
def test_every_encoding_of_pcd_is_read_with_its_fields(tmp_path, encoding):
    fields = ("x", "y", "z", "intensity", "t", "ring")
    columns = [*POINTS.T, np.arange(50.0), np.arange(50) * 1000, np.arange(50) % 4]
    types = (np.float32, np.float32, np.float32, np.float32, np.uint32, np.uint16)
    PointCloud.from_points(columns, fields, types).save(tmp_path / "a.pcd", encoding=encoding)
    read = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_allclose(read.points_m, POINTS, atol=1e-5)
    np.testing.assert_array_equal(read.intensity, np.arange(50.0))
    np.testing.assert_array_equal(read.t_ns, np.arange(50) * 1000)
    np.testing.assert_array_equal(read.ring, np.arange(50) % 4)


def test_a_scan_keeps_its_fields(tmp_path):
    scan = LidarScan(
        stamp_ns=0, seq=0, frame="lidar", points_m=POINTS, intensity=[7.0] * 50, t_ns=range(50), ring=[3] * 50
    )
    write_scan(tmp_path / "data0.pcd", scan)
    read = read_cloud(tmp_path / "data0.pcd")
    np.testing.assert_array_equal(read.t_ns, np.arange(50))
    assert set(read.ring) == {3}


def compressed(num_points, stored, held, content):
    header = HEADER.replace("WIDTH 2", f"WIDTH {num_points}").replace("POINTS 2", f"POINTS {num_points}")
    header = header.replace("ascii", "binary_compressed")
    return header.encode() + np.array([stored, held], "<u4").tobytes() + content


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (compressed(2, 9, 25, bytes(9)), "says 24 bytes of points, the compressed data hold 25"),
        (compressed(2, 9, 24, bytes(8)), "the compressed data are cut off: 8 of 9 bytes"),
        (compressed(10**7, 9, 12 * 10**7, bytes(9)), "9 compressed bytes cannot hold 120000000"),
        (compressed(2, 9, 24, b"\xff" * 9), "the compressed data are broken"),
        (compressed(2, 2, 24, b"\x00a"), "the compressed data are broken"),
    ],
)
def test_compressed_points_that_are_broken(tmp_path, content, reason):
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(CloudFileError, match=reason):
        read_cloud(tmp_path / "a.pcd")


def test_colours_in_las_have_16_bits(tmp_path):
    write_cloud(tmp_path / "a.las", POINTS[:1], np.array([[0, 128, 255]], dtype=np.uint8))
    assert np.frombuffer((tmp_path / "a.las").read_bytes()[-6:], "<u2").tolist() == [0, 128 * 257, 65535]


def test_padding_arrays_doubles_and_big_endian_are_read(tmp_path):
    record = np.dtype([("a", "<u1", 2), ("b", "<f4", 33), ("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("c", "<u1")])
    rows = np.zeros(2, record)
    rows["x"], rows["y"], rows["z"] = 1 / 3, 2.0, 3.0
    header = "# x\nVERSION .7\nFIELDS _ fpfh x y z _\nSIZE 1 4 8 8 8 1\nTYPE U F F F F U\nCOUNT 2 33 1 1 1 1\n"
    header += "WIDTH 1\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
    (tmp_path / "a.pcd").write_bytes(header.encode() + rows.tobytes())
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd").points_m, [[1 / 3, 2, 3]] * 2)
    header = "ply\r\nformat binary_big_endian 1.0\r\nelement thing 1\r\nproperty short s\r\nelement vertex 1\r\n"
    header += "".join(f"property float {name}\r\n" for name in "zyx") + "element face 0\r\n"
    header += "property list uchar int vertex_indices\r\nend_header\r\n"
    (tmp_path / "a.ply").write_bytes(header.encode() + b"\0\0" + np.array([3, 2, 1], ">f4").tobytes())
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points_m, [[1, 2, 3]])


def test_a_mesh_as_ascii_ply_gives_its_vertices(tmp_path, write_tetrahedron):
    write_tetrahedron(tmp_path / "a.ply")
    assert read_cloud(tmp_path / "a.ply").points_m.sum() == 3.0


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "not a PCD file"),
        ("hello\nworld\n", "not a PCD file"),
        (HEADER.partition("POINTS")[0], "the header has no DATA line"),
        (TWO[:-4], "4 values are no whole number of points"),
        (TWO[:-6], "says 2 points, the data hold 1: cut off"),
        (TWO + "7 8 9\n", "says 2 points, the data hold 3: the header is wrong"),
        (TWO.replace("5", "five"), "not a number in the data"),
        (TWO.replace("POINTS 2", "POINTS 3"), "POINTS is 3, but WIDTH times HEIGHT is 2"),
        (TWO.replace("2\n", "99999999999\n"), "says 99999999999 points, the data hold 2"),
        (TWO.replace("WIDTH 2", "WIDTH -2"), "WIDTH is '-2', must be whole numbers"),
        (TWO.replace("FIELDS x y z", "FIELDS x y r"), "no field z; its fields are x, y, r"),
        (TWO.replace("FIELDS x y z", "FIELDS x y"), "not of the same length"),
        (TWO.replace("TYPE F", "TYPE Q"), "field x: there is no type Q of 4 bytes"),
        (TWO.replace("COUNT 1", "COUNT 0"), "field x: COUNT is 0"),
        (TWO.replace("DATA ascii", "DATA morse"), "DATA is 'morse'"),
        (TWO.replace("SIZE 4 4 4\n", ""), "the header has no SIZE"),
        (TWO.replace("ascii", "binary"), "says 2 points, the data hold 1"),
        (TWO.replace("ascii", "binary_compressed"), "the compressed data hold"),
        (HEADER.replace("ascii", "binary_compressed"), "the compressed data are cut off"),
    ],
)
def test_a_pcd_that_is_broken_is_named_with_the_reason(tmp_path, content, reason):
    (tmp_path / "a.pcd").write_text(content)
    with pytest.raises(CloudFileError, match=rf"a\.pcd: .*{reason}"):
        read_cloud(tmp_path / "a.pcd")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.ply", b"plyx\n", "not a PLY file"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "no end_header"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "it has no vertices"),
        ("a.ply", b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "'property float x' is not understood"),
        ("a.las", b"LAZZ", "not a LAS file"),
        ("a.las", b"LASF" + bytes(100), "the header is cut off"),
        ("a.las", b"LASF" + bytes(223), "a point is said to have 0 bytes"),
        ("a.las", b"LASF" + bytes(100) + b"\x80" + bytes(122), "LAZ"),
    ],
)
def test_other_files_that_are_broken_too(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CloudFileError, match=reason):
        read_cloud(tmp_path / name)


@pytest.mark.parametrize("name", ["cut.pcd", "cut.ply", "cut.las"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(share=st.floats(0, 0.999))
def test_a_file_cut_off_anywhere_is_refused(tmp_path, name, share):
    write_cloud(tmp_path / name, POINTS)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(CloudFileError, match=name):
        read_cloud(tmp_path / name)


@pytest.mark.parametrize("name", ["bad.pcd", "bad.ply", "bad.las"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(data=st.data())
def test_bytes_that_flip_give_points_or_one_error(tmp_path, name, data):
    write_cloud(tmp_path / name, POINTS[:4])
    if name.endswith(".pcd"):
        cloud = PointCloud.from_path(tmp_path / name)
        cloud.save(tmp_path / name, encoding=data.draw(st.sampled_from(list(Encoding)[:3])))
    content = bytearray((tmp_path / name).read_bytes())
    for _ in range(3):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / name).write_bytes(content)
    with contextlib.suppress(CloudFileError):
        assert read_cloud(tmp_path / name).points_m.shape[1] == 3


def test_paths_that_cannot_be_used_are_wrong_usage(tmp_path):
    with pytest.raises(InputFileError, match=r"a\.xyz: clouds are read from \.pcd, \.ply, \.las, not '\.xyz'"):
        read_cloud(tmp_path / "a.xyz")
    with pytest.raises(InputFileError, match=r"written as \.pcd, \.ply, \.las"):
        write_cloud(tmp_path / "a", POINTS)
    with pytest.raises(InputFileError, match=r"a\.pcd: No such file"):
        read_cloud(tmp_path / "a.pcd")
    with pytest.raises(InputFileError, match=r"absent/a\.pcd: No such file"):
        write_cloud(tmp_path / "absent" / "a.pcd", POINTS)
    with pytest.raises(InputFileError, match="finite coordinates only"):
        write_cloud(tmp_path / "a.las", np.full((1, 3), np.nan))


def test_scans_come_in_the_order_of_their_numbers_and_gaps_are_named(tmp_path):
    for name in ("data10.pcd", "data2.pcd", "data0.pcd", "data003.pcd", "labels1.npy", "data1.pcd.bak"):
        (tmp_path / name).touch()
    found = scan_files(tmp_path)
    assert [(number, path.name) for number, path in found.paths.items()] == [
        (0, "data0.pcd"),
        (2, "data2.pcd"),
        (3, "data003.pcd"),
        (10, "data10.pcd"),
    ]
    assert found.missing == ("data1.pcd", "data4.pcd to data9.pcd")


def test_the_numbering_begins_with_0(tmp_path):
    (tmp_path / "data2.pcd").touch()
    assert scan_files(tmp_path).missing == ("data0.pcd to data1.pcd",)


def test_folders_without_usable_scans_are_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"has no files data0\.pcd"):
        scan_files(tmp_path)
    with pytest.raises(InputFileError, match="No such file"):
        scan_files(tmp_path / "absent")
    (tmp_path / "data1.pcd").touch()
    (tmp_path / "data01.pcd").touch()
    with pytest.raises(InputFileError, match=r"data01\.pcd and data1\.pcd have the same number"):
        scan_files(tmp_path)


def test_millimetres_are_suspected_but_not_far_places():
    assert unit_warning(POINTS) is None
    assert unit_warning(np.empty((0, 3))) is None
    assert unit_warning(np.full((4, 3), np.nan)) is None
    assert unit_warning(POINTS + 1e6) is None
    assert "millimetres" in unit_warning(POINTS * 1000)
