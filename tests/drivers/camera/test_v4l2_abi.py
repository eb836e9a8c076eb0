"""The numbers of the kernel's interface, and what of a real kernel a machine without a camera has."""

import ctypes
import os
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.camera import uvc_abi as uvc
from drivers.camera import v4l2_abi as v4l2
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import LinuxKernel
from drivers.protocols import DeviceError
from tests.bench.v4l2_bench import (
    HEIGHT,
    WIDTH,
)

# The numbers of <linux/videodev2.h>, <linux/uvcvideo.h> and <linux/usb/video.h>.

C_STRUCTS: dict[type[ctypes.Structure], str] = {
    v4l2.Capability: "struct v4l2_capability",
    v4l2.FmtDesc: "struct v4l2_fmtdesc",
    v4l2.FrmSizeDiscrete: "struct v4l2_frmsize_discrete",
    v4l2.FrmSizeStepwise: "struct v4l2_frmsize_stepwise",
    v4l2.FrmSizeEnum: "struct v4l2_frmsizeenum",
    v4l2.FrmIvalStepwise: "struct v4l2_frmival_stepwise",
    v4l2.FrmIvalEnum: "struct v4l2_frmivalenum",
    v4l2.PixFormat: "struct v4l2_pix_format",
    v4l2.Format: "struct v4l2_format",
    v4l2.Fract: "struct v4l2_fract",
    v4l2.CaptureParm: "struct v4l2_captureparm",
    v4l2.StreamParm: "struct v4l2_streamparm",
    v4l2.RequestBuffers: "struct v4l2_requestbuffers",
    v4l2.Timeval: "struct timeval",
    v4l2.Timecode: "struct v4l2_timecode",
    v4l2.Buffer: "struct v4l2_buffer",
    uvc.XuControlQuery: "struct uvc_xu_control_query",
}


def abi_facts() -> Iterator[tuple[str, int]]:
    """Yield every number the driver relies on as a C expression and our value."""
    for name, value in (vars(v4l2) | vars(uvc)).items():
        if re.match("V4L2_|VIDIOC_|UVC", name):
            yield name, value
    for python, c_name in C_STRUCTS.items():
        yield f"sizeof({c_name})", ctypes.sizeof(python)
        for name, *_ in python._fields_:
            if not name.startswith("_"):
                yield f"offsetof({c_name}, {name})", getattr(python, name).offset
    yield "offsetof(struct v4l2_frmsizeenum, discrete)", v4l2.FrmSizeEnum.discrete.offset
    yield "offsetof(struct v4l2_frmsizeenum, stepwise)", v4l2.FrmSizeEnum.stepwise.offset
    yield "offsetof(struct v4l2_frmivalenum, discrete)", v4l2.FrmIvalEnum.discrete.offset
    yield "offsetof(struct v4l2_frmivalenum, stepwise)", v4l2.FrmIvalEnum.stepwise.offset


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.skipif(not Path("/usr/include/linux/videodev2.h").exists(), reason="no linux/videodev2.h")
@pytest.mark.skipif(sys.maxsize < 2**32, reason="the layouts are those of 64-bit Linux")
def test_every_number_and_layout_is_that_of_the_kernels_header(tmp_path: Path) -> None:
    facts = dict(abi_facts())
    assert len(facts) > 100
    lines = "".join(f'printf("%llu\\n", (unsigned long long)(unsigned int)({expression}));\n' for expression in facts)
    source = tmp_path / "abi.c"
    source.write_text(
        "#include <stddef.h>\n#include <stdio.h>\n"
        "#include <linux/usb/video.h>\n#include <linux/uvcvideo.h>\n#include <linux/videodev2.h>\n"
        f"int main(void) {{\n{lines}}}\n"
    )
    subprocess.run(["gcc", "-o", tmp_path / "abi", source], check=True)
    printed = subprocess.run([tmp_path / "abi"], check=True, capture_output=True, text=True).stdout
    header = dict(zip(facts, map(int, printed.split()), strict=True))
    assert facts == header


def test_format_codes_read_as_their_four_characters() -> None:
    assert v4l2.fourcc("YUYV") == 0x56595559
    assert v4l2.fourcc_name(v4l2.V4L2_PIX_FMT_MJPEG) == "MJPG"


# The real kernel, as far as a machine without a camera has one.


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("/dev/no-such-camera", r"/dev/no-such-camera: no such device; cameras are /dev/video\*"),
        ("/dev/null", r"/dev/null: no V4L2 camera \(asking for its capabilities: Inappropriate ioctl"),
        ("/dev", "/dev: cannot be opened: Is a directory"),
    ],
)
def test_a_path_that_is_no_camera_gets_one_clear_line(path: str, line: str) -> None:
    with pytest.raises(DeviceError, match=line) as caught:
        V4l2StereoCamera(path, WIDTH, HEIGHT, pool_frames=2)
    assert "\n" not in str(caught.value)


def test_kernel_maps_and_polls_real_descriptors(tmp_path: Path) -> None:
    kernel = LinuxKernel()
    path = tmp_path / "buffer"
    path.write_bytes(bytes(range(256)) * 16)
    fd = kernel.open(str(path))
    mapping = kernel.mmap(fd, 4096, 0)
    assert mapping[255] == 255
    mapping.close()
    kernel.close(fd)

    ours, theirs = os.pipe()
    assert kernel.poll(ours, 0.0) == 0
    os.write(theirs, b"x")
    assert kernel.poll(ours, 0.0) == select.POLLIN
    os.close(theirs)
    assert kernel.poll(ours, 0.0) & select.POLLHUP
    kernel.close(ours)
