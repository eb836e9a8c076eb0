"""Which effects of the wearable show alike, from the Fisher matrix of one recording.

With J the columns of all effects' parameters, whitened and with the base model's own projected out, F = JᵀJ is what the
recording tells of them. Effect b can stand for effect a as far as b's columns explain a's,

    share(a, b) = max over a of  aᵀ F_ab F_bb⁻¹ F_ba a / aᵀ F_aa a,                                                 (1)

and what is left of a's evidence χ² when b is fitted in its place is (1 − share) χ².

    python -m systems.wearable.look_alikes RECORDING
"""

import sys
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np

from discrepancy.simulation import Effect
from discrepancy.values import predicted
from messages.arrays import FloatArray
from systems.wearable.simulation import WearableSimulation, load

ALIKE = 0.9
"""From this share on two effects are called look-alikes: less than a tenth of the evidence tells them apart."""
_SHOWN = 0.5
"""From this share on a pair is listed."""
_RIDGE = 1e-9
"""Of all columns' power: parameters of one choice that say the same leave its matrix invertible."""
_MOST_FOLLOWS = 0.98
"""Of a residual that follows from the sample before: with more, the filter would take away all that is slow."""


def shares(simulation: WearableSimulation) -> tuple[tuple[str, ...], FloatArray]:
    """Return the candidates' names, one for each choice of an effect, and (1) for each pair, (m, m)."""
    base = predicted(simulation, {})
    residual = simulation.channels.values - base
    seen = np.isfinite(residual).all(axis=1)
    residual = residual[seen] - residual[seen].mean(axis=0)
    follows = np.clip((residual[1:] * residual[:-1]).sum(axis=0) / (residual**2).sum(axis=0), 0.0, _MOST_FOLLOWS)
    innovation = residual[1:] - follows * residual[:-1]
    deviation = innovation.std(axis=0)

    def white(change: FloatArray) -> FloatArray:
        rows = change[seen]
        whitened: FloatArray = ((rows[1:] - follows * rows[:-1]) / deviation).ravel()
        return whitened

    own = [white(predicted(simulation, {p.name: p.neutral + p.scale}) - base) for p in simulation.parameters]
    Q = np.linalg.qr(np.stack(own, axis=-1))[0]
    names, blocks = [], []
    for effect in simulation.effects:
        for choice in effect.choices or (tuple(p.name for p in effect.parameters),):
            J = np.stack(_columns(simulation, effect, choice, white, base), axis=-1)
            names.append(effect.name if not effect.choices else f"{effect.name}.{'+'.join(choice)}")
            blocks.append(J - Q @ (Q.T @ J))
    table = np.eye(len(names))
    for a, b in combinations(range(len(names)), 2):
        table[a, b], table[b, a] = _share(blocks[a], blocks[b]), _share(blocks[b], blocks[a])
    return tuple(names), table


def _columns(
    simulation: WearableSimulation,
    effect: Effect,
    choice: tuple[str, ...],
    white: Callable[[FloatArray], FloatArray],
    base: FloatArray,
) -> list[FloatArray]:
    """Return a whitened column for each parameter of the choice, or the whole change at each start."""
    if effect.starts:
        starts = [{effect.qualified(n): v for n, v in start.items() if n in choice} for start in effect.starts]
        return [white(predicted(simulation, start) - base) for start in starts]
    scales = {p.name: p.scale for p in effect.parameters}
    return [white(predicted(simulation, {effect.qualified(name): scales[name]}) - base) for name in choice]


def _share(a: FloatArray, b: FloatArray) -> float:
    inner = b.T @ b
    inner[np.diag_indices(len(inner))] += _RIDGE * np.trace(inner)
    explained = a.T @ b @ np.linalg.solve(inner, b.T @ a)
    whole = a.T @ a
    whole[np.diag_indices(len(whole))] += _RIDGE * np.trace(whole)
    return float(np.clip(np.linalg.eigvals(np.linalg.solve(whole, explained)).real.max(), 0.0, 1.0))


def main() -> None:
    """Print every pair of effects of which one explains half or more of the other."""
    names, table = shares(load(Path(sys.argv[1])))
    print("effect | stands in for | share of its evidence | look-alike")
    print("--- | --- | --- | ---")
    for a, b in sorted(np.ndindex(*table.shape), key=lambda pair: -table[pair]):
        different = names[a].split(".")[0] != names[b].split(".")[0]
        if different and table[a, b] >= _SHOWN:
            print(f"{names[b]} | {names[a]} | {table[a, b]:.3f} | {'yes' if table[a, b] >= ALIKE else 'no'}")


if __name__ == "__main__":
    main()
