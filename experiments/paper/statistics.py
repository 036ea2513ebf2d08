"""What the paper sees in a curve, as a number: functions of sampled signals, in numpy alone.

Times are increasing and need not be even: averages weigh every sample by the time that it stands for. Signals have one
entry a sample; a signal that is a vector has its components along the last axis.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Signal = NDArray[np.floating]


def size(vectors: Signal) -> Signal:
    """The magnitude of a signal that is a vector."""
    return np.linalg.norm(vectors, axis=-1)


def mean(time: Signal, signal: Signal) -> float:
    """Time average."""
    return float(np.trapezoid(signal, time) / (time[-1] - time[0]))


def rms(time: Signal, signal: Signal) -> float:
    """Root of the time average of the square."""
    return float(np.sqrt(mean(time, signal * signal)))


def spread(time: Signal, signal: Signal) -> float:
    """Standard deviation over time: the RMS about the time average."""
    return rms(time, signal - mean(time, signal))


def peak(signal: Signal) -> float:
    """The largest magnitude."""
    return float(np.max(np.abs(signal)))


def peak_time(time: Signal, signal: Signal) -> float:
    """When the largest magnitude is reached first [s]."""
    return float(time[np.argmax(np.abs(signal))])


def within(time: Signal, begin: float, end: float) -> NDArray[np.bool_]:
    """The samples from begin to end [s], both included."""
    return (time >= begin) & (time <= end)


def share_above(time: Signal, signal: Signal) -> float:
    """Part of the time in which a signal is above zero."""
    above = np.where(signal > 0, 1.0, np.where(signal < 0, 0.0, 0.5))
    return mean(time, above)


def even(time: Signal, signal: Signal, count: int) -> tuple[Signal, Signal]:
    """Times at equal distances, and the signal there (linear between its samples)."""
    times = np.linspace(time[0], time[-1], count)
    return times, np.interp(times, time, signal)


def spectrum(time: Signal, signal: Signal, count: int = 2**14) -> tuple[Signal, Signal]:
    """Frequencies [Hz] and amplitudes of the signal about its mean, with a Hann window; of a sine, its amplitude."""
    times, values = even(time, signal, count)
    window = np.hanning(count)
    amplitudes = np.abs(np.fft.rfft(window * (values - np.mean(values)))) * 2 / np.sum(window)
    return np.fft.rfftfreq(count, times[1] - times[0]), amplitudes


def centre_frequency(time: Signal, signal: Signal) -> float:
    """Mean frequency of the spectrum, weighed by power [Hz]."""
    frequency, amplitude = spectrum(time, signal)
    power = amplitude**2
    return float(np.sum(frequency * power) / np.sum(power))


def maxima(time: Signal, signal: Signal, width: float) -> Signal:
    """The largest value in each of the windows of about `width` [s] that the time is cut into."""
    return np.maximum.reduceat(signal, _cuts(time, width))


def ranges(time: Signal, signal: Signal, width: float) -> Signal:
    """Highest minus lowest value in each of the windows of about `width` [s] that the time is cut into."""
    return maxima(time, signal, width) + maxima(time, -signal, width)


def _cuts(time: Signal, width: float) -> NDArray[np.integer]:
    """The first sample of each window."""
    count = max(1, round((time[-1] - time[0]) / width))
    return np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[:-1])


def in_common(a: Signal, b: Signal, share: float = 0.1) -> float:
    """Of the places of the largest entries of `a`, a `share` of all, the part that are those of `b` too."""
    count = max(1, round(share * a.size))
    return len(set(np.argsort(a)[-count:]) & set(np.argsort(b)[-count:])) / count


def correlation(a: Signal, b: Signal) -> float:
    """Pearson's correlation of samples."""
    return float(np.corrcoef(a, b)[0, 1])


def power_of(x: Signal, y: Signal) -> float:
    """The exponent p of y ~ x^p through points (least squares of the logarithms)."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def contact_share(starts: Signal, ends: Signal, end: float) -> float:
    """Part of the time from 0 to `end` [s] that episodes of contact fill; one without an end (NaN) lasts to `end`."""
    return float(np.sum(np.where(np.isnan(ends), end, np.minimum(ends, end)) - starts) / end)


def lag(time: Signal, signal: Signal, reference: Signal, count: int = 2**12) -> float:
    """By how much a signal comes later than a reference [s]: where their correlation is largest."""
    times, a = even(time, signal, count)
    _, b = even(time, reference, count)
    product = np.correlate(a - np.mean(a), b - np.mean(b), "full")
    return float((np.argmax(product) - (count - 1)) * (times[1] - times[0]))


def rises(values: Sequence[float], by: float = 0.05) -> bool:
    """Whether each number is larger than the one before it, and the last larger than the first by the share `by`."""
    ordered = np.all(np.diff(values) > 0)
    return bool(ordered and values[-1] - values[0] > by * abs(values[0]))


def falls(values: Sequence[float], by: float = 0.05) -> bool:
    """Whether each number is smaller than the one before it, and the last smaller than the first by the share `by`."""
    ordered = np.all(np.diff(values) < 0)
    return bool(ordered and values[0] - values[-1] > by * abs(values[0]))
