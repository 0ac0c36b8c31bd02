"""Draws convex faces into an image of inverse depths.

On a face's plane n . p = d the inverse depth is affine in the pixel: 1/z = (n . ray(u, v)) / d. A row of pixels meets a
convex polygon in one span. So each face fills spans, and the largest inverse depth stays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared.kernel import kernel

Float = NDArray[np.float64]

_EDGE_ON_M = 1e-9
"""A face whose plane passes the camera nearer than this covers no pixel."""


class Faces(NamedTuple):
    """A scene as the kernels take it, each shape in its link's frame; see `Scene` for what is not said here.

    normals (F, 3): unit, outwards; 0 for a face without area. offsets_m (F,): of the faces' planes, n . p. first_face
    (M + 1,): the faces of shape i are those from first_face[i] on. centres_m (M, 3), radii_m (M,): bounding spheres.
    """

    vertices_m: Float
    starts: NDArray[np.int64]
    normals: Float
    offsets_m: Float
    first_face: NDArray[np.int64]
    shape_link: NDArray[np.int32]
    is_convex: NDArray[np.bool_]
    centres_m: Float
    radii_m: Float


class View(NamedTuple):
    """A pinhole camera's intrinsics in pixels, and the depths between which it sees."""

    height: int
    width: int
    fx: float
    fy: float
    cx: float
    cy: float
    near_m: float
    far_m: float


class Scratch(NamedTuple):
    """Room to work in. points_m (P, 3): of one shape, in the camera's frame. clipped_m (C, 3), pixels (C, 2): of one
    polygon. left, right (H,): the span of each row.
    """

    points_m: Float
    clipped_m: Float
    pixels: Float
    left: Float
    right: Float


@kernel()
def draw(
    faces: Faces,
    rotations: Float,
    translations_m: Float,
    view: View,
    inverse_depth: NDArray[np.float32],
    face: NDArray[np.int32],
    distance_m: NDArray[np.float32],
) -> None:
    """Draws every shape.

    rotations (L, 3, 3), translations_m (L, 3): T_camera_link. inverse_depth, face (H, W): 0 and -1 where nothing is.
    distance_m (F,): of each drawn face's plane from the camera.
    """
    scratch = _scratch(faces, view)
    inverse_depth[:] = np.float32(0.0)
    face[:] = np.int32(-1)
    for shape in range(len(faces.shape_link)):
        link = faces.shape_link[shape]
        R, t = rotations[link], translations_m[link]
        if _is_in_view(R, t, faces.centres_m[shape], faces.radii_m[shape], view):
            _draw_shape(faces, shape, R, t, view, scratch, inverse_depth, face, distance_m)


@kernel()
def _scratch(faces: Faces, view: View) -> Scratch:
    most_corners, most_points = 0, 0
    for k in range(len(faces.starts) - 1):
        most_corners = max(most_corners, faces.starts[k + 1] - faces.starts[k])
    for shape in range(len(faces.shape_link)):
        first, end = faces.first_face[shape], faces.first_face[shape + 1]
        most_points = max(most_points, faces.starts[end] - faces.starts[first])
    return Scratch(
        points_m=np.empty((most_points, 3)),
        clipped_m=np.empty((most_corners + 1, 3)),
        pixels=np.empty((most_corners + 1, 2)),
        left=np.empty(view.height),
        right=np.empty(view.height),
    )


@kernel()
def _is_in_view(R: Float, t: Float, centre_m: Float, radius_m: float, view: View) -> bool:
    """Whether a sphere reaches into the pyramid that the camera sees."""
    x = R[0, 0] * centre_m[0] + R[0, 1] * centre_m[1] + R[0, 2] * centre_m[2] + t[0]
    y = R[1, 0] * centre_m[0] + R[1, 1] * centre_m[1] + R[1, 2] * centre_m[2] + t[1]
    z = R[2, 0] * centre_m[0] + R[2, 1] * centre_m[1] + R[2, 2] * centre_m[2] + t[2]
    if z + radius_m < view.near_m or z - radius_m > view.far_m:
        return False
    across = _is_between(x, z, view.cx / view.fx, (view.width - 1 - view.cx) / view.fx, radius_m)
    return across and _is_between(y, z, view.cy / view.fy, (view.height - 1 - view.cy) / view.fy, radius_m)


@kernel(inline="always")
def _is_between(x: float, z: float, tan_before: float, tan_after: float, radius_m: float) -> bool:
    before = -x - tan_before * z <= radius_m * math.sqrt(1.0 + tan_before * tan_before)
    after = x - tan_after * z <= radius_m * math.sqrt(1.0 + tan_after * tan_after)
    return before and after


@kernel()
def _draw_shape(
    faces: Faces,
    shape: int,
    R: Float,
    t: Float,
    view: View,
    scratch: Scratch,
    inverse_depth: NDArray[np.float32],
    face: NDArray[np.int32],
    distance_m: NDArray[np.float32],
) -> None:
    first, end = faces.first_face[shape], faces.first_face[shape + 1]
    start = faces.starts[first]
    nearest_m = _transform(faces.vertices_m[start : faces.starts[end]], R, t, scratch.points_m)
    is_front_only = faces.is_convex[shape] and (nearest_m >= view.near_m or _is_apart(faces, first, end, R, t, view))
    for k in range(first, end):
        n = _turned(R, faces.normals[k])
        d = faces.offsets_m[k] + n[0] * t[0] + n[1] * t[1] + n[2] * t[2]
        if abs(d) < _EDGE_ON_M or (is_front_only and d > 0.0):
            continue
        distance_m[k] = np.float32(abs(d))
        points = scratch.points_m[faces.starts[k] - start : faces.starts[k + 1] - start]
        num_corners = _project(points, view, scratch)
        if num_corners >= 3:
            ray = (n[0] / (view.fx * d), n[1] / (view.fy * d), n[2] / d)
            _fill(ray, num_corners, np.int32(k), view, scratch, inverse_depth, face)


@kernel(inline="always")
def _turned(R: Float, v: Float) -> tuple[float, float, float]:
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@kernel()
def _transform(vertices_m: Float, R: Float, t: Float, points_m: Float) -> float:
    """The vertices in the camera's frame; the least depth of them."""
    nearest_m = np.inf
    for i in range(len(vertices_m)):
        x, y, z = _turned(R, vertices_m[i])
        points_m[i, 0], points_m[i, 1], points_m[i, 2] = x + t[0], y + t[1], z + t[2]
        nearest_m = min(nearest_m, z + t[2])
    return nearest_m


@kernel()
def _is_apart(faces: Faces, first: int, end: int, R: Float, t: Float, view: View) -> bool:
    """Whether one of the faces has the whole near rectangle before it: no ray then begins in the convex shape."""
    left, right = -view.cx / view.fx, (view.width - 1 - view.cx) / view.fx
    top, bottom = -view.cy / view.fy, (view.height - 1 - view.cy) / view.fy
    for k in range(first, end):
        nx, ny, nz = _turned(R, faces.normals[k])
        d = faces.offsets_m[k] + nx * t[0] + ny * t[1] + nz * t[2]
        least = view.near_m * (min(nx * left, nx * right) + min(ny * top, ny * bottom) + nz)
        if least > d:
            return True
    return False


@kernel()
def _project(points_m: Float, view: View, scratch: Scratch) -> int:
    """Cuts a polygon off at the near plane (Sutherland, Hodgman 1974), projects it; how many corners are left."""
    num, count = 0, len(points_m)
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        z, z_next = points_m[i, 2], points_m[j, 2]
        if z >= view.near_m:
            scratch.clipped_m[num] = points_m[i]
            num += 1
        if (z >= view.near_m) != (z_next >= view.near_m):
            share = (view.near_m - z) / (z_next - z)
            scratch.clipped_m[num, 0] = points_m[i, 0] + share * (points_m[j, 0] - points_m[i, 0])
            scratch.clipped_m[num, 1] = points_m[i, 1] + share * (points_m[j, 1] - points_m[i, 1])
            scratch.clipped_m[num, 2] = view.near_m
            num += 1
    for i in range(num):
        scratch.pixels[i, 0] = view.fx * scratch.clipped_m[i, 0] / scratch.clipped_m[i, 2] + view.cx
        scratch.pixels[i, 1] = view.fy * scratch.clipped_m[i, 1] / scratch.clipped_m[i, 2] + view.cy
    return num


@kernel()
def _fill(
    ray: tuple[float, float, float],
    num_corners: int,
    k: np.int32,
    view: View,
    scratch: Scratch,
    inverse_depth: NDArray[np.float32],
    face: NDArray[np.int32],
) -> None:
    """Fills the pixels whose centre is in the polygon. ray: by what 1/z grows a column, a row, and what it is ahead."""
    top, bottom = _bounds(scratch.pixels, num_corners, 1, view.height)
    first_column, last_column = _bounds(scratch.pixels, num_corners, 0, view.width)
    if top > bottom or first_column > last_column:
        return
    _find_spans(scratch, num_corners, top, bottom)
    for v in range(top, bottom + 1):
        start = max(0, math.ceil(max(scratch.left[v], -1.0)))
        end = min(view.width - 1, math.floor(min(scratch.right[v], view.width + 0.0)))
        if start <= end:
            at_centre = ray[2] + ray[1] * (v - view.cy)
            ends = (at_centre + ray[0] * (start - view.cx), at_centre + ray[0] * (end - view.cx))
            _fill_span(inverse_depth[v, start : end + 1], face[v, start : end + 1], ends[0], ends[1], ray[0], k)


@kernel()
def _bounds(pixels: Float, num_corners: int, axis: int, size: int) -> tuple[int, int]:
    """First and last pixel whose centre is within the corners' reach along an axis, and in the image."""
    low, high = np.inf, -np.inf
    for i in range(num_corners):
        low, high = min(low, pixels[i, axis]), max(high, pixels[i, axis])
    return max(0, math.ceil(max(low, -1.0))), min(size - 1, math.floor(min(high, size + 0.0)))


@kernel()
def _find_spans(scratch: Scratch, num_corners: int, top: int, bottom: int) -> None:
    """Where each row from top to bottom enters and leaves the polygon."""
    scratch.left[top : bottom + 1] = np.inf
    scratch.right[top : bottom + 1] = -np.inf
    for corner in range(num_corners):
        i, j = corner, (corner + 1 if corner + 1 < num_corners else 0)
        if scratch.pixels[i, 1] > scratch.pixels[j, 1]:
            i, j = j, i
        x, y, x_next, y_next = scratch.pixels[i, 0], scratch.pixels[i, 1], scratch.pixels[j, 0], scratch.pixels[j, 1]
        if y == y_next:
            continue
        slope, low, high = (x_next - x) / (y_next - y), min(x, x_next), max(x, x_next)
        for v in range(max(top, math.ceil(max(y, -1.0))), min(bottom, math.floor(min(y_next, bottom + 1.0))) + 1):
            at = min(max(x + (v - y) * slope, low), high)
            scratch.left[v] = min(scratch.left[v], at)
            scratch.right[v] = max(scratch.right[v], at)


@kernel(fastmath={"contract", "nsz"})
def _fill_span(
    inverse_depth: NDArray[np.float32],
    face: NDArray[np.int32],
    at_start: float,
    at_end: float,
    step: float,
    k: np.int32,
) -> None:
    """Counts from the end that is farther away: sums of positive numbers lose no digits."""
    n = len(inverse_depth)
    origin = np.float32(0.0) if at_start <= at_end else np.float32(n - 1)
    base, slope = np.float32(min(at_start, at_end)), np.float32(step)
    for i in range(n):
        w = base + slope * (np.float32(i) - origin)
        if w > inverse_depth[i]:
            inverse_depth[i] = w
            face[i] = k


@kernel(fastmath={"contract", "nsz", "arcp", "reassoc"})
def finish(
    inverse_depth: NDArray[np.float32],
    face: NDArray[np.int32],
    distance_m: NDArray[np.float32],
    view: View,
    cos_incidence: NDArray[np.float32],
) -> None:
    """Inverse depths become depths in place, inf where there is nothing up to the far end.

    cos_incidence (H, W): a plane's distance over the distance to the point on it.
    """
    x_squared = ((np.arange(view.width) - view.cx) / view.fx).astype(np.float32) ** 2
    least = np.float32(1.0 / view.far_m)
    for v in range(view.height):
        y = (v - view.cy) / view.fy
        rest = np.float32(1.0 + y * y)
        for u in range(view.width):
            w = inverse_depth[v, u]
            is_hit = w >= least
            length = np.sqrt(rest + x_squared[u])
            distance = distance_m[max(face[v, u], 0)]
            cos_incidence[v, u] = min(w * distance / length, np.float32(1.0)) if is_hit else np.float32(0.0)
            inverse_depth[v, u] = np.float32(1.0) / w if is_hit else np.float32(np.inf)
            face[v, u] = face[v, u] if is_hit else np.int32(-1)
