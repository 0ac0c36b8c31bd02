"""Every whole chunk is read, wherever a file was cut off or damaged; and `recover` makes a whole file of them."""

import shutil

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from services.recorder.bag.mcap_blocks import McapBlocks
from services.recorder.bag.overview import overview_of
from services.recorder.bag.recorded import RecordingReader
from services.recorder.bag.recovery import recover
from services.recorder.bag.verification import verified
from shared.errors import InputFileError
from tests.support.recordings import NUM_SECONDS, said, write_recording


@pytest.fixture(params=["lz4", "zstd", "none"])
def path(request, tmp_path):
    return write_recording(tmp_path / "run.mcap", compression=request.param)


def chunks_of(path):
    """Offset, end and number of messages of each chunk."""
    with path.open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
    found = [(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length) for index in indexes]
    nums = {block.offset: sum(hasattr(record, "log_time") for record in block.records) for block in blocks_of(path)[0]}
    return [(begin, end, nums[begin]) for begin, end in sorted(found)]


def blocks_of(path):
    blocks = McapBlocks(path)
    return list(blocks.blocks()), blocks


def num_messages(path):
    return sum(1 for _ in RecordingReader(path).messages())


def spoil(path, offset, xor=0xFF):
    content = bytearray(path.read_bytes())
    content[offset] ^= xor
    path.write_bytes(content)


def cut(path, num_bytes):
    with path.open("r+b") as file:
        file.truncate(num_bytes)


def test_a_whole_file(path):
    _, blocks = blocks_of(path)
    assert (blocks.is_complete, blocks.damage, blocks.num_chunks) == (True, [], NUM_SECONDS)
    messages = [(recorded.channel, recorded.message()) for recorded in RecordingReader(path).messages()]
    assert messages == said()


def test_cut_anywhere_every_whole_chunk_is_read(path, tmp_path):
    chunks = chunks_of(path)
    size = path.stat().st_size
    cuts = {size - 1, size - 9, size - 40, size - 400}
    for begin, end, _ in chunks:
        cuts |= {begin, begin + 1, begin + 5, begin + 9, begin + 30, (begin + end) // 2, end - 1, end, end + 3}
    for num_bytes in sorted(cuts):
        shutil.copy(path, tmp_path / "cut.mcap")
        cut(tmp_path / "cut.mcap", num_bytes)
        whole = sum(num for _, end, num in chunks if end <= num_bytes)
        assert num_messages(tmp_path / "cut.mcap") == whole, num_bytes
        assert not blocks_of(tmp_path / "cut.mcap")[1].is_complete


@pytest.mark.parametrize("number", range(NUM_SECONDS))
@pytest.mark.parametrize("place", ["opcode", "length", "high length", "time", "crc", "name", "data", "last"])
def test_a_damaged_chunk_costs_itself_alone(path, number, place):
    chunks = chunks_of(path)
    begin, end, num = chunks[number]
    at = {"opcode": 0, "length": 1, "high length": 6, "time": 16, "crc": 34, "name": 37, "data": 200, "last": -1}[place]
    spoil(path, begin + at if at >= 0 else end + at)
    assert num_messages(path) == sum(of for _, _, of in chunks) - num
    (damage,) = [damage for damage in blocks_of(path)[1].damage if damage.has_data]
    assert damage.offset == begin


def test_a_damaged_record_between_chunks_costs_none(path):
    chunks = chunks_of(path)
    content = path.read_bytes()
    after = chunks[1][1]
    assert content[after] == Opcode.MESSAGE_INDEX
    for offset in (after, after + 1, after + 3):
        spoil(path, offset)
        assert num_messages(path) == sum(num for _, _, num in chunks)
        path.write_bytes(content)


def test_a_damaged_index_costs_nothing(path):
    num = num_messages(path)
    spoil(path, path.stat().st_size - 200)
    assert num_messages(path) == num
    _, blocks = blocks_of(path)
    assert [damage.has_data for damage in blocks.damage] == [False]
    assert overview_of(path).state == "INCOMPLETE"


def test_a_recovered_file_is_whole(path, tmp_path):
    chunks = chunks_of(path)
    spoil(path, (chunks[2][0] + chunks[2][1]) // 2)
    cut(path, chunks[4][0] + 50)
    before = path.read_bytes()
    out = tmp_path / "out.mcap"
    recovered = recover(path, out)
    assert path.read_bytes() == before
    kept = [recorded.message() for recorded in RecordingReader(path).messages()]
    assert [recorded.message() for recorded in RecordingReader(out).messages()] == kept
    assert sum(recovered.num_messages.values()) == len(kept) == sum(chunks[k][2] for k in (0, 1, 3))
    assert recovered.num_lost == {"/clock": 20, "/lidar/points": 10}
    assert recovered.has_losses
    assert recovered.num_lost_bytes == chunks[2][1] - chunks[2][0] + 50
    overview = overview_of(out)
    assert (overview.has_index, overview.state, overview.num_chunks) == (True, "INCOMPLETE", 3)
    assert overview.run == {"version": "1.2.3", "seed": "7"}
    assert "recovered from run.mcap" in overview.problems[0]
    assert sum(report.num_gaps for report in verified(out).topics.values()) == 30


def test_the_end_cut_off_without_a_chunk_is_no_loss_but_no_end(path, tmp_path):
    cut(path, chunks_of(path)[-1][1])
    recovered = recover(path, tmp_path / "out.mcap")
    assert not recovered.num_lost
    assert sum(recovered.num_messages.values()) == len(said())
    assert [str(damage) for damage in recovered.damage] == [f"cut off: 0 bytes from byte {path.stat().st_size} on"]


def test_without_its_first_chunk_names_come_from_the_index(path, tmp_path):
    chunks = chunks_of(path)
    spoil(path, chunks[0][0] + 100)
    assert sum(recover(path, tmp_path / "out.mcap").num_messages.values()) == sum(num for _, _, num in chunks[1:])


def test_without_first_chunk_and_index_messages_are_counted_as_nameless(path, tmp_path):
    chunks = chunks_of(path)
    spoil(path, chunks[0][0] + 100)
    cut(path, chunks[-1][1])
    with pytest.raises(InputFileError, match="nothing can be recovered"):
        recover(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()
    reader = RecordingReader(path)
    assert list(reader.messages()) == []
    assert reader.unknown.total() == sum(num for _, _, num in chunks[1:])


def test_nothing_is_overwritten(path, tmp_path):
    (tmp_path / "out.mcap").write_text("mine")
    with pytest.raises(InputFileError, match=r"out\.mcap: cannot be written: File exists"):
        recover(path, tmp_path / "out.mcap")
    assert (tmp_path / "out.mcap").read_text() == "mine"


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x06" * 100_000])
def test_what_is_no_recording(tmp_path, content):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    for read in (overview_of, verified, lambda path: recover(path, tmp_path / "out.mcap")):
        with pytest.raises(InputFileError, match=r"other\.mcap: is (no MCAP file|empty)"):
            read(path)
    with pytest.raises(InputFileError, match="No such file"):
        overview_of(tmp_path / "none.mcap")
