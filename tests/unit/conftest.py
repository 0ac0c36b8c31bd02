from collections.abc import Callable
from pathlib import Path

import pytest

TETRAHEDRON_PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""


@pytest.fixture
def write_tetrahedron() -> Callable[[Path], None]:
    """Writes a closed mesh of 1/6 m3, with its right angle at the origin, as an ASCII PLY file."""
    return lambda path: path.write_text(TETRAHEDRON_PLY, encoding="ascii")
