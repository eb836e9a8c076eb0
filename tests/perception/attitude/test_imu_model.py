import numpy as np

from messages import ImuCalibration, ImuSample
from perception.attitude.imu_model import corrected


def test_calibration_is_matrix_times_measured_less_bias() -> None:
    rng = np.random.default_rng(1)
    sf_matrix, w_matrix = np.eye(3) + 0.03 * rng.standard_normal((2, 3, 3))
    sf, sf_bias, w, w_bias = rng.standard_normal((4, 3))

    def rows(matrix: np.ndarray) -> tuple[tuple[float, float, float], ...]:
        return tuple((float(a), float(b), float(c)) for a, b, c in matrix)

    (a, b, c), (d, e, f) = rows(sf_matrix), rows(w_matrix)
    biases = rows(np.stack((sf_bias, w_bias, sf, w)))
    calibration = ImuCalibration(
        sf_matrix=(a, b, c), sf_bias_mps2=biases[0], w_matrix=(d, e, f), w_bias_radps=biases[1]
    )
    sample = ImuSample(
        seq=0, t_sample_ns=1, t_arrival_ns=2, sf_B_mps2=biases[2], w_WB_B_radps=biases[3], temperature_degC=25.0
    )
    sf_B_mps2, w_WB_B_radps = corrected(sample, calibration)
    np.testing.assert_allclose(sf_B_mps2, sf_matrix @ (sf - sf_bias), rtol=1e-12)
    np.testing.assert_allclose(w_WB_B_radps, w_matrix @ (w - w_bias), rtol=1e-12)
