"""How people walk, as numbers: mean curves of level walking at a natural speed, over one cycle of a leg.

A cycle runs from one contact of a foot (phase 0) to its next (phase 1); the other leg is half a cycle later. Values
are rounded to a degree from these sources:

- hip and knee: Winter, *Biomechanics and Motor Control of Human Movement* (4th ed., 2009), natural cadence; Perry and
  Burnfield, *Gait Analysis* (2nd ed., 2010), for the values at the ends of the phases of gait;
- foot against the floor, pelvis and height: Murray, Drought and Kory, *Walking patterns of normal men* (J. Bone Joint
  Surg. 46-A, 1964); Inman, Ralston and Todd, *Human Walking* (1981);
- arms and shoulder girdle: Murray, Sepic and Barnard, *Patterns of sagittal rotation of the upper limbs in walking*
  (Physical Therapy 47, 1967).
"""

from __future__ import annotations

import numpy as np

TOE_OFF = 0.62
"""Phase at which a foot leaves the floor."""

CADENCE = 112.0
"""Steps per minute."""

# Every 5 % of the cycle, flexion positive [degrees].
_HIP = (19, 19, 17, 14, 10, 5, 0, -4, -8, -10, -11, -9, -3, 5, 12, 17, 20, 22, 22, 21)
_KNEE = (4, 10, 16, 19, 19, 16, 12, 9, 7, 9, 15, 25, 39, 53, 62, 63, 55, 38, 18, 5)
_HARMONICS = 5

# Phase and angle of the foot against the floor, toes up positive [degrees]. At toe off a real heel is turned further,
# about the ball of the foot; these bodies have no joint there and turn about the toes.
_FOOT = ((0.0, 20.0), (0.08, 0.0), (0.36, 0.0), (0.70, -44.0), (0.92, 18.0), (1.0, 20.0))


def hip_flexion(phase: np.ndarray) -> np.ndarray:
    """Thigh forward of the vertical [rad]."""
    return _periodic(_HIP, phase)


def knee_flexion(phase: np.ndarray) -> np.ndarray:
    """Shank back of the thigh [rad]."""
    return _periodic(_KNEE, phase)


def foot_pitch(phase: np.ndarray) -> np.ndarray:
    """Foot against the floor [rad], toes up positive; exactly zero while the foot is flat."""
    knots, values = np.array(_FOOT).T
    place = np.mod(phase, 1.0)
    i = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
    s = (place - knots[i]) / (knots[i + 1] - knots[i])
    return np.radians(values[i] + (values[i + 1] - values[i]) * s * s * (3.0 - 2.0 * s))


def pelvis_turn(left_phase: np.ndarray) -> np.ndarray:
    """Pelvis about the vertical [rad], left side forward positive: 5 degrees forward where that foot lands."""
    return np.radians(5.0) * np.cos(2 * np.pi * left_phase)


def pelvis_list(left_phase: np.ndarray) -> np.ndarray:
    """Pelvis about the line of walking [rad], left side up positive: the swinging side drops by 4 degrees."""
    return np.radians(4.0) * np.cos(2 * np.pi * (left_phase - 0.15))


def girdle_turn(left_phase: np.ndarray) -> np.ndarray:
    """Shoulder girdle about the vertical [rad], left side forward positive: 4 degrees against the pelvis."""
    return -np.radians(4.0) * np.cos(2 * np.pi * left_phase)


def shoulder_flexion(phase: np.ndarray) -> np.ndarray:
    """Upper arm forward of the vertical [rad]: 24 degrees back where the foot of its side lands, then 8 forward."""
    return np.radians(-8.0 - 16.0 * np.cos(2 * np.pi * phase))


def elbow_flexion(phase: np.ndarray) -> np.ndarray:
    """Forearm forward of the upper arm [rad]: 17 to 43 degrees, most when the arm is forward."""
    return np.radians(30.0 - 13.0 * np.cos(2 * np.pi * (phase - 0.03)))


def rise(left_phase: np.ndarray, stride: float) -> np.ndarray:
    """Height of the pelvis over its mean [m]: lowest with both feet down, highest above either leg.

    It rises by 45 mm at a stride of 1.56 m, and with the square of the stride.
    """
    return -0.0225 * (stride / 1.56) ** 2 * np.cos(4 * np.pi * (left_phase - 0.03))


def sway(left_phase: np.ndarray) -> np.ndarray:
    """Pelvis to the left of the line of walking [m]: 20 mm toward the standing leg."""
    return 0.020 * np.cos(2 * np.pi * (left_phase - 0.30))


def _periodic(degrees: tuple[float, ...], phase: np.ndarray) -> np.ndarray:
    """The Fourier series, cut after a few harmonics, through values evenly spaced over a cycle [rad]."""
    spectrum = np.fft.rfft(np.radians(degrees))[: _HARMONICS + 1] / len(degrees)
    spectrum[1:] *= 2.0
    turns = np.multiply.outer(np.asarray(phase, float), np.arange(_HARMONICS + 1))
    return (spectrum * np.exp(2j * np.pi * turns)).real.sum(axis=-1)
