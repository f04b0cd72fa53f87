"""Random ground and random noise whose variance and wavelength are known.

All heights are functions of x and y in metres around the middle of a square site. The *wavelength*
of a random field is where its power for each octave, k**2 S(k), is largest, S being the spectral
density in the plane and k the wavenumber. For the Matern covariances (Rasmussen & Williams 2006,
eq. 4.14) with length l that is at k = sqrt(2) / l whatever their smoothness, so that

    wavelength = sqrt(2) pi l = 4.44 l

holds for exponential (smoothness 1/2), Matern 3/2 and 5/2, and Gaussian fields (infinite).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable, Mapping

import numpy as np
from scipy import fft, ndimage

from quantify_client.types import FloatArray

Height = Callable[[FloatArray, FloatArray], FloatArray]

#: A spectral density, up to a factor, from wavenumbers (radians / m) and the wavelength (m).
Spectrum = Callable[[FloatArray, float], FloatArray]

#: Wavelength of a Matern field in lengths of its covariance.
WAVELENGTH = math.sqrt(2) * math.pi

#: Steps of a field for each wavelength, for the width of a site, and along a side at most.
_PER_WAVELENGTH, _PER_SITE, _MOST_STEPS = 16, 60, 1024

#: Wavelength of cubic value noise in steps of its lattice: (sin u / u)**8 u**2 is largest at
#: u = 0.84, u being half of the wavenumber times the step.
_LATTICE = math.pi / 0.84


@dataclass(frozen=True)
class Field:
    """A periodic random field: cubic splines over a square lattice.

    Attributes
    ----------
    coefficients : (n, n) float64, of the splines, metres.
    step : of the lattice, metres.
    """

    coefficients: FloatArray
    step: float

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the heights at places of any shape."""
        middle = len(self.coefficients) / 2
        places = [np.asarray(y) / self.step + middle, np.asarray(x) / self.step + middle]
        heights = ndimage.map_coordinates(
            self.coefficients, places, order=3, mode="grid-wrap", prefilter=False
        )
        return np.asarray(heights)


@dataclass(frozen=True)
class Sum:
    """The sum of heights, each times a factor."""

    terms: tuple[tuple[float, Height], ...]

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the heights at places of any shape."""
        return np.asarray(sum(factor * height(x, y) for factor, height in self.terms) + 0.0 * x)


def matern(smoothness: float) -> Spectrum:
    """Return the spectral density of a Matern field in the plane; `math.inf` for a Gaussian one.

    Rasmussen & Williams 2006, eq. 4.15 with D = 2: S ~ (2 nu / l**2 + k**2) ** -(nu + 1).
    """

    def density(k: FloatArray, wavelength: float) -> FloatArray:
        square = (k * wavelength / WAVELENGTH) ** 2
        if math.isinf(smoothness):
            return np.asarray(np.exp(-square / 2))
        return np.asarray((1 + square / (2 * smoothness)) ** -(smoothness + 1))

    return density


def fractal(beta: float) -> Spectrum:
    """Return the density k**-beta of waves no longer than the wavelength."""

    def density(k: FloatArray, wavelength: float) -> FloatArray:
        relative = k * wavelength / (2 * math.pi)
        return np.where(relative >= 1, np.maximum(relative, 1) ** -beta, 0.0)

    return density


def gaussian_field(
    rng: np.random.Generator, spectrum: Spectrum, width: float, wavelength: float
) -> Field:
    """Return a Gaussian random field of variance 1 over a site of the given width.

    It repeats itself only beyond the site and two wavelengths, so that its covariance over the site
    is that of the spectrum. The variance is that of the process: one site sees less of long waves.
    """
    side = width + 2 * wavelength
    step = max(min(wavelength / _PER_WAVELENGTH, width / _PER_SITE), side / _MOST_STEPS)
    n = fft.next_fast_len(math.ceil(side / step), real=True)
    step = side / n
    k = 2 * math.pi * np.hypot(fft.fftfreq(n, step)[:, None], fft.rfftfreq(n, step))
    density = spectrum(k, wavelength)
    twice = np.full(k.shape[1], 2.0)
    twice[0] = 1.0
    if n % 2 == 0:
        twice[-1] = 1.0
    gain = np.sqrt(density * n**2 / (density * twice).sum())
    values = fft.irfft2(fft.rfft2(rng.standard_normal((n, n))) * gain, (n, n))
    return Field(ndimage.spline_filter(values, 3, mode="grid-wrap"), step)


# --- kinds of ground, each of variance 1


def _exponential(rng: np.random.Generator, width: float, wavelength: float) -> Height:
    return gaussian_field(rng, matern(0.5), width, wavelength)


def _gaussian(rng: np.random.Generator, width: float, wavelength: float) -> Height:
    return gaussian_field(rng, matern(math.inf), width, wavelength)


def _fractal(rng: np.random.Generator, width: float, wavelength: float) -> Height:
    return gaussian_field(rng, fractal(rng.uniform(2, 4)), width, wavelength)


@dataclass(frozen=True)
class Waves:
    """Plane waves of one length in several directions.

    Attributes
    ----------
    wavenumbers : (K, 2) float64, radians / m.
    phases : (K,) float64.
    """

    wavenumbers: FloatArray
    phases: FloatArray

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the heights at places of any shape, of variance 1 over the plane."""
        waves = (
            np.sin(kx * x + ky * y + phase)
            for (kx, ky), phase in zip(self.wavenumbers, self.phases)
        )
        return np.asarray(sum(waves) * math.sqrt(2 / len(self.phases)))


def _sinusoids(rng: np.random.Generator, width: float, wavelength: float) -> Height:
    count = int(rng.integers(1, 7))
    angle, phases = rng.uniform(0, 2 * math.pi, (2, count))
    k = 2 * math.pi / wavelength
    return Waves(k * np.column_stack([np.cos(angle), np.sin(angle)]), phases)


def _value_noise(rng: np.random.Generator, width: float, wavelength: float) -> Height:
    """Return independent uniform values on a lattice, smoothed by cubic B-splines."""
    step = wavelength / _LATTICE
    n = math.ceil((width + 2 * wavelength) / step)
    values = rng.uniform(-1, 1, (n, n)) * math.sqrt(3)
    # The mean over a step of the sum of the squares of a cubic B-spline's weights is 151 / 315.
    return Field(values * 315 / 151, step)


#: Kinds of ground of variance 1, from a generator of random numbers, the width of the site and the
#: wavelength, metres.
RELIEFS: Mapping[str, Callable[[np.random.Generator, float, float], Height]] = {
    "exponential": _exponential,
    "gaussian": _gaussian,
    "fractal": _fractal,
    "sinusoids": _sinusoids,
    "value noise": _value_noise,
}


def plane(slope: float, azimuth: float) -> Height:
    """Return a plane that rises by a slope (a tangent) towards an azimuth (from x to y)."""
    east, north = slope * math.cos(azimuth), slope * math.sin(azimuth)
    return lambda x, y: np.asarray(east * x + north * y)
