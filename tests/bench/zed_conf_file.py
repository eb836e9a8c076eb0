"""A ZED's factory calibration file, as StereoLabs writes it."""

from pathlib import Path

LEFT = {"fx": 701.88, "fy": 701.7, "cx": 641.285, "cy": 344.1835, "k1": -0.175, "k2": 0.028, "p1": 6e-5, "p2": -1.5e-4}
RIGHT = {"fx": 700.965, "fy": 701.11, "cx": 633.515, "cy": 359.3135, "k1": -0.173, "k2": 0.027, "p1": 2e-4, "p2": 1e-5}
STEREO = {"Baseline": 119.978, "TY": 0.026, "TZ": 0.0159, "RX_HD": -0.0009, "CV_HD": 0.0062, "RZ_HD": 0.00077}
Sections = dict[str, dict[str, float]]


def sections(mode: str = "HD") -> Sections:
    stereo = {key.replace("HD", mode): value for key, value in STEREO.items()}
    return {f"LEFT_CAM_{mode}": LEFT | {"k3": 0.0}, f"RIGHT_CAM_{mode}": RIGHT | {"k3": 0.0}, "STEREO": stereo}


def text_of(content: Sections) -> str:
    return "".join(
        f"[{section}]\n" + "".join(f"{key}={value!r}\n" for key, value in keys.items()) + "\n"
        for section, keys in content.items()
    )


def conf(folder: Path, content: Sections | str) -> Path:
    path = folder / "SN1234.conf"
    path.write_text(content if isinstance(content, str) else text_of(content), encoding="utf-8")
    return path
