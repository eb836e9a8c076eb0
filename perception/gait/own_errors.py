"""How far off the predictions of contacts have been: a limp lands late on one side, and steps scatter."""

import math


class OwnErrors:
    """Compares each contact with what was predicted of it `AHEAD_ROWS` before; all in rows of the trail."""

    def __init__(self) -> None:
        self._predicted: dict[int, float] = {}
        self._late = [0.0, 0.0]
        self._square = _FIRST_SIGMA**2

    def foretell(self, number: int, row: float, rows: float) -> None:
        """Note that contact `number` is predicted at `row`, `rows` from now."""
        if rows >= AHEAD_ROWS:
            self._predicted = {**{n: r for n, r in self._predicted.items() if n >= number - 1}, number: row}

    def happened(self, number: int, row: float) -> None:
        """Take a contact at `row`."""
        predicted = self._predicted.pop(number, math.nan)
        if math.isnan(predicted):
            return
        off = min(max(row - predicted, -_MOST_OFF), _MOST_OFF)
        left = off - self._late[number % 2]
        self._late[number % 2] += _FOLLOWS * left
        self._square += _SQUARE_FOLLOWS * (left**2 - self._square)

    def late(self, number: int, rows: float) -> float:
        """Return how much later than the phase says contact `number` will be, `rows` from now."""
        return self._late[number % 2] * min(1.0, rows / AHEAD_ROWS)

    def sigma(self, rows: float) -> float:
        """Return one σ of contacts `rows` from now, as they have scattered."""
        return math.sqrt(self._square * max(rows, 0.2 * AHEAD_ROWS) / AHEAD_ROWS)


AHEAD_ROWS = 25.0
_FIRST_SIGMA = 2.5
_MOST_OFF = 12.0
_FOLLOWS = 0.3
_SQUARE_FOLLOWS = 0.12
