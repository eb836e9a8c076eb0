"""The choice of frames on the 50 ms grid, for any jitter, loss and phase, against a choice that knows the future."""

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.camera.frame_grid import GRID_NS, GridPicker

RATE_HZ = 60.0
PERIOD_NS = round(1e9 / RATE_HZ)
JITTER_NS = 3_000_000

jitters = st.lists(st.integers(-JITTER_NS, JITTER_NS), min_size=40, max_size=160)


def stamps(jitter_ns: list[int], start_ns: int) -> list[int]:
    return [start_ns + frame * PERIOD_NS + error_ns for frame, error_ns in enumerate(jitter_ns)]


def picked(times_ns: list[int], rate_hz: float = RATE_HZ) -> list[int]:
    picker = GridPicker(1.0 / rate_hz)
    return [t_ns for t_ns in times_ns if picker.pick(t_ns)]


@settings(deadline=None)
@given(jitters, st.integers(0, 10**13))
def test_every_third_frame_under_jitter(jitter_ns: list[int], start_ns: int) -> None:
    """±3 ms never reaches the middle between two frames, ±8.3 ms, though the first stamp sets the phase."""
    times = stamps(jitter_ns, start_ns)
    assert picked(times) == times[::3]


@st.composite
def lossy_streams(draw: st.DrawFn) -> list[int]:
    times = stamps(draw(jitters), draw(st.integers(0, 10**13)))
    kept = draw(st.lists(st.booleans(), min_size=len(times), max_size=len(times)))
    return [t_ns for t_ns, is_kept in zip(times, kept, strict=True) if is_kept]


@settings(deadline=None)
@given(lossy_streams())
def test_no_grid_point_is_served_twice_and_time_never_runs_back(times: list[int]) -> None:
    """Two picks may serve neighbouring points from their near sides; n + 1 picks in a row span n - 1 steps at least."""
    chosen = picked(times)
    assert chosen[:1] == times[:1]
    slowest_step_ns = round(0.95 * GRID_NS)  # the phase moves by a tenth of half a step at most
    for later in range(len(chosen)):
        for earlier in range(later):
            assert chosen[later] - chosen[earlier] > (later - earlier - 1) * slowest_step_ns


@st.composite
def scattered_losses(draw: st.DrawFn) -> set[int]:
    """Frames lost by ones and twos, with enough between them that most intervals are still one period."""
    lost: set[int] = set()
    frame = 10
    for gap, run in draw(st.lists(st.tuples(st.integers(5, 20), st.integers(1, 2)), max_size=20)):
        frame += gap
        lost |= set(range(frame, frame + run))
    return lost


@settings(deadline=None)
@given(scattered_losses(), st.lists(st.integers(-JITTER_NS, JITTER_NS), min_size=120, max_size=120))
def test_the_nearest_frame_that_arrived_serves_each_point(lost: set[int], jitter_ns: list[int]) -> None:
    """The grid lies on frames 3k: 3k if it arrived, else 3k + 1 if that did; never 3k + 2, which belongs to 3k + 3."""
    times = stamps(jitter_ns, 0)
    arrived = [frame for frame in range(120) if frame not in lost]
    picker = GridPicker(1.0 / RATE_HZ)
    chosen = {frame for frame in arrived if picker.pick(times[frame])}
    for point in range(0, 120, 3):
        if point in arrived:
            assert point in chosen
            assert point + 1 not in chosen
        elif point + 1 in arrived:
            assert point + 1 in chosen
        assert point + 2 not in chosen


@settings(deadline=None)
@given(st.floats(22.0, 120.0), st.integers(0, 2**32))
def test_twenty_a_second_from_any_faster_camera(rate_hz: float, start_ns: int) -> None:
    """Give or take what the phase may follow: the camera's clock where a whole number of its periods makes a step."""
    times = [start_ns + round(frame * 1e9 / rate_hz) for frame in range(round(10 * rate_hz))]
    assert abs(len(picked(times, rate_hz)) - 200) <= 6


@settings(deadline=None)
@given(st.floats(1.0, 19.5), st.floats(15.0, 100.0))
def test_every_frame_from_any_slower_camera(rate_hz: float, nominal_hz: float) -> None:
    """At once where the rate was known, and otherwise as soon as the intervals told it."""
    times = [round(frame * 1e9 / rate_hz) for frame in range(100)]
    assert picked(times, rate_hz) == times
    misled = set(picked(times, nominal_hz))
    assert set(times[9:]) <= misled
    assert len(misled) >= 97
