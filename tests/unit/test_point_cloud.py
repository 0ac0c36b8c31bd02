"""PointCloud2 of any make: what drivers write, and what does not fit."""

import numpy as np
import pytest

from services.sensors.sources.point_cloud import scan_of
from tests.support.bags import cloud

STAMP_NS = 1_650_408_693_802_616_064  # a float64 holds it: a multiple of 256


def table(dtype, **columns):
    (num_points,) = {len(values) for values in columns.values()}
    records = np.zeros(num_points, dtype)
    for name, values in columns.items():
        records[name] = values
    return records


def scan(records, stamp_ns=STAMP_NS, **options):
    return scan_of(cloud(records, stamp_ns, **options), stamp_ns, 7, "lidar")


X, Y, Z = [1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0]
POINTS_M = np.array([X, Y, Z], dtype=np.float32).T
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def test_ouster():
    dtype = np.dtype(
        {
            "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring"],
            "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2"],
            "offsets": [0, 4, 8, 16, 20, 24, 26],
            "itemsize": 48,
        }
    )
    records = table(dtype, x=X, y=Y, z=Z, intensity=[1, 2, 300, np.nan], t=[5, 6, 7, 8], ring=[0, 0, 1, 1])
    read = scan(records)
    assert (read.stamp_ns, read.seq, read.frame) == (STAMP_NS, 7, "lidar")
    np.testing.assert_array_equal(read.points_m, POINTS_M)
    np.testing.assert_array_equal(read.intensity, [1, 2, 255, 0])
    np.testing.assert_array_equal(read.t_ns, [5, 6, 7, 8])
    np.testing.assert_array_equal(read.ring, [0, 0, 1, 1])


def test_only_coordinates_in_another_order_and_type():
    read = scan(table([("z", ">f8"), ("y", ">i2"), ("x", ">f4")], x=X, y=Y, z=Z))
    np.testing.assert_array_equal(read.points_m, POINTS_M)
    for zeros in (read.intensity, read.t_ns, read.ring):
        np.testing.assert_array_equal(zeros, [0, 0, 0, 0])


def test_organised_with_padded_rows():
    np.testing.assert_array_equal(scan(table(XYZ, x=X, y=Y, z=Z), height=2, row_padding=5).points_m, POINTS_M)


def test_points_that_are_none_are_dropped():
    read = scan(
        table([*XYZ, ("ring", "<u2")], x=[0, np.nan, 3, 0], y=[0, 6, np.inf, 8], z=[0, 1, 2, 0], ring=[1, 2, 3, 4])
    )
    np.testing.assert_array_equal(read.points_m, [[0, 8, 0]])
    np.testing.assert_array_equal(read.ring, [4])


def test_an_empty_cloud():
    assert len(scan(table([*XYZ, ("t", "<u4")], x=[], y=[], z=[], t=[])).points_m) == 0


def test_points_in_the_order_of_firing_are_sorted_by_ring():
    records = table([*XYZ, ("ring", "<u1"), ("t", "<u4")], x=X, y=Y, z=Z, ring=[1, 0, 1, 0], t=[1, 1, 2, 2])
    read = scan(records)
    np.testing.assert_array_equal(read.points_m, POINTS_M[[1, 3, 0, 2]])
    np.testing.assert_array_equal(read.ring, [0, 0, 1, 1])
    np.testing.assert_array_equal(read.t_ns, [1, 2, 1, 2])


@pytest.mark.parametrize(
    ("name", "dtype", "times", "stamp_ns", "t_ns"),
    [
        ("time", "<f4", [0.0, 0.25, 0.5, 0.75], 0, [0, 250_000_000, 500_000_000, 750_000_000]),
        ("time", "<f4", [-0.5, -0.25, 0.0, 0.25], -500_000_000, [0, 250_000_000, 500_000_000, 750_000_000]),
        ("timestamp", "<f8", [STAMP_NS + 512, STAMP_NS, STAMP_NS + 256, STAMP_NS], 0, [512, 0, 256, 0]),
        ("timestamp", "<f8", [STAMP_NS - 512, STAMP_NS, STAMP_NS + 256, STAMP_NS], -512, [0, 512, 768, 512]),
        ("timestamp", "<f8", [1e13 + 9, 1e13, 1e13 + 1, 1e13], 0, [9, 0, 1, 0]),
    ],
)
def test_times(name, dtype, times, stamp_ns, t_ns):
    read = scan(table([*XYZ, (name, dtype)], x=X, y=Y, z=Z, **{name: times}))
    assert read.stamp_ns == STAMP_NS + stamp_ns
    np.testing.assert_array_equal(read.t_ns, t_ns)


def test_absolute_times_in_float_seconds():
    stamp_ns = 1_650_408_693_500_000_000
    times = [1_650_408_693.5, 1_650_408_693.75, 1_650_408_693.5, 1_650_408_694.0]
    read = scan(table([*XYZ, ("timestamp", "<f8")], x=X, y=Y, z=Z, timestamp=times), stamp_ns)
    assert read.stamp_ns == stamp_ns
    np.testing.assert_array_equal(read.t_ns, [0, 250_000_000, 0, 500_000_000])


def test_what_does_not_fit():
    records = table(XYZ, x=X, y=Y, z=Z)
    good = cloud(records, STAMP_NS)
    for change, reason in (
        ({"data": good.data[:-1]}, "its 47 bytes do not hold 1 x 4 points of 12 bytes in rows of 48"),
        ({"point_step": 11}, "its fields reach beyond its point_step of 11 bytes"),
        ({"fields": good.fields[:2]}, "it has no field z; its fields are x, y"),
        ({"height": 2, "row_step": 1}, "its 48 bytes do not hold 2 x 4 points of 12 bytes in rows of 1"),
    ):
        bad = type(good)(**{**{name: getattr(good, name) for name in good.__dataclass_fields__}, **change})
        with pytest.raises(ValueError, match=reason):
            scan_of(bad, STAMP_NS, 0, "lidar")
    for times, reason in (([0, 0, 0, 4.4], "its times span 4.400 s"), ([0, 0, 0, np.nan], "is not finite")):
        with pytest.raises(ValueError, match=reason):
            scan(table([*XYZ, ("time", "<f8")], x=X, y=Y, z=Z, time=times))
