"""Claims about the gains and margins of the LQI loop."""

import math

import numpy as np
import pytest
import scipy.linalg
from controller_rig import SETTINGS
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.laws.lqi_design import design, disk_margin, loop, margins, model, rational_loop, step_response
from controller.laws.lqi_settings import Lags

LQI = SETTINGS.lateral.lqi
NEED = LQI.margins
lag = st.floats(0.0, 0.3)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.5, 40.0), lag, lag, lag)
def test_the_gains_solve_the_riccati_equation_of_the_cost(speed_mps, dead_s, steering_s, tyres_s):
    lags = Lags(dead_s, steering_s, tyres_s).noticeable()
    found = design(speed_mps, lags, LQI)
    omega = found.bandwidth_radps
    a, b, states = model(lags)
    cost = [(LQI.integral * omega) ** 2, 1.0, (LQI.damping / omega) ** 2, 0.0, 0.0]
    k = np.array(found.gains)[states]
    # Kalman's identity of an optimal loop: |1 + K·(jω - A)⁻¹B|² = 1 + Bᵀ(-jω - Aᵀ)⁻¹·Q·(jω - A)⁻¹B/ρ.
    for at in omega * np.geomspace(0.1, 10.0, 7):
        g = np.linalg.solve(1j * at * np.eye(len(a)) - a, b)
        expected = 1.0 + float(np.sum(np.array(cost)[states] * np.abs(g) ** 2)) * omega**4
        assert abs(1.0 + k @ g) ** 2 == pytest.approx(expected, rel=1e-6)
    assert (np.linalg.eigvals(a - np.outer(b, k)).real < 0.0).all()


@settings(max_examples=8, deadline=None)
@given(st.floats(0.5, 40.0), lag, lag, lag)
def test_every_design_has_the_demanded_margins(speed_mps, dead_s, steering_s, tyres_s):
    lags = Lags(dead_s, steering_s, tyres_s).noticeable()
    found = design(speed_mps, lags, LQI).margins
    assert found.gain_db >= NEED.gain_db
    assert found.phase_rad >= NEED.phase_rad
    assert found.delay_s >= NEED.delay_s + NEED.delay_share * sum(lags)


def test_a_design_without_integral_has_none():
    assert (
        design(10.0, Lags(0.1, 0.1, 0.0), LQI.model_copy(update=dict(integral=0.0))).gains.integral_1ps3
        == 0.0
    )


def test_the_loop_with_prediction_is_that_of_a_simulated_one():
    """L at one frequency, from the response of plant and predictor to a sine, by steps of a millisecond."""
    a, b, _ = model(Lags(0.2, 0.1, 0.0))
    k, dead_s, omega, h = np.array([0.3, 4.0, 3.5, 0.4]), 0.2, 3.0, 0.001
    n = round(dead_s / h)
    step = scipy.linalg.expm(np.block([[a, b[:, None]], [np.zeros((1, 5))]]) * h)
    ad, bd = step[:4, :4], step[:4, 4]
    tail = [np.linalg.matrix_power(ad, i) @ bd for i in range(n)]
    # At steady state x(t) = Re(X·e^jωt) for the plant's input e^jω(t-T), and the predictor's own output is v.
    z = np.exp(1j * omega * h)
    x = np.linalg.solve(z * np.eye(4) - ad, bd) * z**-n
    memory = sum(k @ tail[i] * z ** -(i + 1) for i in range(n))
    v = -(k @ np.linalg.matrix_power(ad, n) @ x) / (1.0 + memory)
    assert loop(a, b, k, dead_s, np.array([omega]))[0] == pytest.approx(-v, rel=0.01)


def test_margins_of_a_double_integrator_with_lead_are_those_in_the_textbook():
    omega = np.geomspace(0.01, 100.0, 500)
    s = 1j * omega
    found = margins((1.0 + 2.0 * s) / s**2, omega)
    crossing = math.sqrt(2.0 + math.sqrt(5.0))
    assert found.gain == math.inf
    assert found.phase_rad == pytest.approx(math.atan(2.0 * crossing), abs=1e-3)
    assert found.delay_s == pytest.approx(math.atan(2.0 * crossing) / crossing, rel=1e-3)


def test_the_disk_margin_is_at_most_that_of_the_phase_margin():
    lags = Lags(0.3, 0.2, 0.0)
    found = design(10.0, lags, LQI)
    alpha = disk_margin(found, lags)
    assert 0.3 < alpha <= 2.0 * math.tan(found.margins.phase_rad / 2.0) + 1e-9
    a, b, states = model(lags)
    omega = found.bandwidth_radps * np.geomspace(0.1, 10.0, 50)
    exact = loop(a, b, np.array(found.gains)[states], lags.dead_s, omega)
    assert rational_loop(found, lags)(1j * omega) == pytest.approx(exact, rel=1e-4)


def test_the_step_response_waits_for_the_dead_time_and_settles_on_the_demand():
    lags = Lags(0.3, 0.2, 0.0)
    time_s = np.array([0.0, 0.29, 60.0])
    assert step_response(design(10.0, lags, LQI), lags, time_s) == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
