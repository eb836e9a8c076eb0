"""The identity of this run of the kernel."""

from pathlib import Path

from drivers.boot_id import read_boot_id


def test_the_boot_id_is_read_without_its_line_end(tmp_path: Path) -> None:
    (tmp_path / "boot_id").write_text("2b1c-77\n")
    assert read_boot_id(tmp_path / "boot_id") == "2b1c-77"
