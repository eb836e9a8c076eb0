import numpy as np
import pytest

from messages.arrays import GreyImage
from sim_rig.camera.textures import CANVAS_COLUMNS, MAX_LEVEL, TEXTURES, TILE, canvas, face, texel_m

ROWS = 512


@pytest.mark.parametrize(
    "texture", sorted(TEXTURES.keys() - {"ceiling"})
)  # which shows on a floor at a share of its light
def test_a_surface_has_detail_to_match_and_is_well_exposed(texture: str) -> None:
    surface = canvas(texture, ROWS, 0, 0, 0).astype(float)
    assert 70 < surface.mean() < 180
    assert np.mean((surface < 3) | (surface > 252)) < 0.01
    detail = surface[:, 1:] - surface[:, :-1]
    assert detail.std() > 2.0


@pytest.mark.parametrize("texture", ["brick", "grass", "concrete", "wood"])
def test_tiles_join_without_a_seam(texture: str) -> None:
    surface = canvas(texture, ROWS, 0, 0, 0).astype(float)
    np.testing.assert_array_equal(surface[:, :100], surface[:, TILE : TILE + 100])
    across = np.abs(np.diff(surface, axis=1)).mean(axis=0)
    assert across[TILE - 1] <= across[: TILE - 1].max()


@pytest.mark.parametrize(("row_level", "column_level"), [(1, 0), (0, 1), (2, 1), (MAX_LEVEL, MAX_LEVEL)])
def test_levels_are_the_same_surface_at_the_same_place(row_level: int, column_level: int) -> None:
    full, reduced = canvas("gravel", ROWS, 3, 0, 0), canvas("gravel", ROWS, 3, row_level, column_level)
    assert reduced.shape == ((ROWS >> row_level) + 1, (TILE >> column_level) + CANVAS_COLUMNS)
    nearby = boxed(full, 1 << row_level, 1 << column_level)
    rows, columns = np.mgrid[4 : ROWS >> row_level, 4 : TILE >> column_level]
    at_nodes = nearby[rows << row_level, columns << column_level]
    level = reduced[rows, columns].astype(float)
    assert np.corrcoef(at_nodes.ravel(), level.ravel())[0, 1] > 0.9
    aside = nearby[(rows << row_level) - (1 << row_level), (columns << column_level) - (1 << column_level)]
    assert np.corrcoef(aside.ravel(), level.ravel())[0, 1] < 0.8


def boxed(image: GreyImage, rows: int, columns: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the mean over a box of that many texels, centred on each texel."""
    mean = image.astype(np.float64)
    for axis, size in enumerate((rows, columns)):
        weights = np.full(2 * size - 1, 1.0)
        weights /= weights.sum()
        mean = np.apply_along_axis(np.convolve, axis, mean, weights, mode="same")
    return mean


def test_the_phase_moves_the_surface() -> None:
    here, further = canvas("gravel", ROWS, 0, 0, 0), canvas("gravel", ROWS, 2, 0, 0)
    np.testing.assert_array_equal(here[2 << MAX_LEVEL :], further[: -(2 << MAX_LEVEL)])


@pytest.mark.parametrize(("texture", "period_m"), [("mosaic-6cm", 0.06), ("mosaic-2.5cm", 0.025)])
@pytest.mark.parametrize("level", [0, 2, MAX_LEVEL])
def test_a_mosaic_repeats_exactly_and_its_print_does_not(texture: str, period_m: float, level: int) -> None:
    period = round(period_m / texel_m(texture))
    assert period * texel_m(texture) == pytest.approx(period_m)
    texels = max(1, period >> level)
    alike, varied = (canvas(name, ROWS, 0, level, level) for name in (texture, f"{texture}-varied"))
    np.testing.assert_array_equal(alike[texels:], alike[:-texels])
    np.testing.assert_array_equal(alike[:, texels:], alike[:, :-texels])
    assert (varied[texels:] != varied[:-texels]).mean() > 0.3


def test_a_face_larger_than_a_tile_is_refused() -> None:
    with pytest.raises(ValueError, match="allowed are 1024"):
        face("print", TILE + 1, 10, 0, 0)
