"""Whether the gyros drive an attitude, found out from samples: own only where that shows, else driven."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

import gtmbench as gb
from gtmbench.method.driven_attitude import _beside, _is_equally_late, _missing, _standing, origin_of
from gtmbench.method.rate_spectra import Gain, RateSpectra, spectra_of
from gtmbench.values.attitude_estimators import carried_on
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.night import by_day
from tests.helpers.scripts import script

RATE_HZ = 200.0


@cache
def motion(seconds=60.0):
    """Slow motion: rates, and the attitude that they integrate to."""
    draw = np.random.default_rng(9).standard_normal((int(seconds * RATE_HZ), 3))
    rates = sosfilt(butter(4, [0.1, 1.5], "bandpass", output="sos", fs=RATE_HZ), draw, axis=0)
    rates *= 6.0 / rates.std()
    path = [[2.0, 3.0, 40.0]]
    for before, now in pairwise(rates.tolist()):
        path.append(list(carried_on(path[-1], before, now, 1.0 / RATE_HZ)))
    return rates, np.array(path)


def logged(gyro_noise=0.5, angle_noise=0.0005, *, tau=None, seed=1):
    """A record whose attitude is of its own, or an estimator's of the noisy gyros."""
    draw = np.random.default_rng(seed)
    rates, attitude = motion()
    noisy = rates + gyro_noise * draw.standard_normal(rates.shape)
    own = attitude + angle_noise * draw.standard_normal(attitude.shape)
    record = gb.Record(
        np.hstack([noisy, attitude if tau else own]), channels=[*GYROS, *ATTITUDE], sample_period_s=1.0 / RATE_HZ
    )
    return gb.filtered_attitude(record, time_constant_s=tau, seed=seed) if tau else record


def late(record, rows):
    """The attitude some rows late."""
    for name in ATTITUDE:
        record = record.replace(name, np.concatenate([np.full(rows, record[name][0]), record[name][:-rows]]))
    return record


def smooth(record, hz):
    """The attitude behind a low-pass."""
    low = butter(2, hz, output="sos", fs=RATE_HZ)
    for name in ATTITUDE:
        record = record.replace(name, record[name][0] + sosfilt(low, record[name] - record[name][0]))
    return record


def turning(period_s=0.02, samples=6000):
    """A record of large turns about all axes, by the kinematics of Euler's angles, whose heading goes round."""
    time_s = np.arange(samples) * period_s
    swings = [(25.0, [0.7, 1.9, 4.1]), (20.0, [0.5, 2.3, 3.7]), (90.0, [0.9, 1.3])]
    angles = [sum(size / w * np.sin(w * time_s + w) for w in of) for size, of in swings]
    slopes = [sum(size * np.cos(w * time_s + w) for w in of) for size, of in swings]
    phi, theta = np.radians(angles[0]), np.radians(angles[1])
    p = slopes[0] - slopes[2] * np.sin(theta)
    q = slopes[1] * np.cos(phi) + slopes[2] * np.cos(theta) * np.sin(phi)
    r = slopes[2] * np.cos(theta) * np.cos(phi) - slopes[1] * np.sin(phi)
    values = np.column_stack([p, q, r, angles[0], angles[1], angles[2] % 360.0])
    return gb.Record(values, channels=[*GYROS, *ATTITUDE], sample_period_s=period_s)


def test_a_gyro_stands_whole_in_the_attitudes_rate_however_the_aircraft_turns():
    for spectra in spectra_of([turning()]).values():
        gain = spectra.gain(0.1, 3.0, np.ones(len(spectra.gyro), dtype=bool))
        assert gain.value == pytest.approx(1.0, abs=1e-3)
        assert gain.deviation < 1e-3


def test_white_noise_has_its_density_in_every_band_whatever_slope_it_stands_on():
    noise = 0.4 * np.random.default_rng(2).standard_normal((20_000, 6)) + 0.5 * np.arange(20_000.0)[:, np.newaxis]
    noise[:, 3:] = 0.0
    record = gb.Record(noise, channels=[*GYROS, *ATTITUDE], sample_period_s=0.02)
    spectra = spectra_of([record])["q"]
    every = np.ones(len(spectra.gyro), dtype=bool)
    spread = 4.0 / np.sqrt(len(every))  # of the mean of as many chi squares, with a margin for their overlap
    for low_hz, high_hz in ((0.3, 1.0), (4.0, 8.0), (18.0, 21.0)):
        assert spectra.gain(low_hz, high_hz, every).density == pytest.approx(2.0 * 0.4**2 * 0.02, rel=spread)


def test_eight_windows_that_overlap_by_half_are_the_fewest_and_four_of_them_tell_a_gain():
    longest = 128 + 7 * 64 + 1
    assert "q" not in spectra_of([turning(samples=longest - 1)])
    spectra = spectra_of([turning(samples=longest)])["q"]
    assert len(np.unique(spectra.gyro[:, 1])) == 8
    some = np.arange(len(spectra.gyro)) < 4
    assert spectra.gain(0.1, 3.0, some) is not None
    assert spectra.gain(0.1, 3.0, some & (np.arange(8) > 0)) is None


@pytest.mark.parametrize(
    ("period_s", "samples"), [(0.0139, 128), (0.0137, 256), (0.2, 64), (0.0015, 1024)]
)  # the power of two that is next to 2.5 s, but for the shortest and the longest
def test_a_window_lasts_two_seconds_and_a_half(period_s, samples):
    spectra = spectra_of([turning(period_s, 6 * samples)])["p"]
    assert spectra.frequency_hz[1] == pytest.approx(1.0 / (samples * period_s))


@pytest.mark.parametrize("offset", [0.0, 2000.0])
def test_the_step_of_readings_is_that_of_their_grid(offset):
    record = turning()
    rounded = record.replace("q", offset + 0.0005 * np.rint(0.01 * record["q"] / 0.0005))
    assert spectra_of([rounded])["q"].quantum == pytest.approx(0.0005)
    assert spectra_of([record])["q"].quantum == 0.0
    assert spectra_of([record, rounded])["q"].quantum == pytest.approx(0.0005)
    assert spectra_of([record.replace("q", np.zeros(len(record)))])["q"].quantum == 0.0


@pytest.mark.parametrize("rows", [0, 10])
def test_an_attitude_without_the_gyros_noise_is_of_its_own_late_or_not(rows):
    record = late(logged(), rows) if rows else logged()
    told = origin_of([record])
    assert not told.is_driven
    assert set(told.shares) == set(GYROS)
    assert all(share > 0.9 for share in told.shares.values())
    assert "noise" in told.why


@pytest.mark.parametrize("tau", by_day([0.2, 1.0, 5.0, 20.0], 2))
@pytest.mark.parametrize(
    "change", by_day([lambda r: r, lambda r: late(r, 7), lambda r: smooth(r, 20.0), lambda r: smooth(r, 3.0)], 2)
)
def test_an_attitude_of_the_gyros_is_never_taken_for_its_own(tau, change):
    told = origin_of([change(logged(tau=tau))])
    assert told.is_driven
    assert told.is_assumed


@pytest.mark.parametrize(
    "record",
    [
        logged(gyro_noise=0.0),
        logged(gyro_noise=0.02, angle_noise=0.05),  # the attitude's own noise hides the gyros'
        gb.decimate(logged(), 4),  # at 50 Hz noise folds back into the gyros alone
        logged().select(["p", "phi", "theta", "psi"]),
        logged().between(0.0, 2.0),
    ],
    ids=["no noise", "loud attitude", "50 Hz", "one gyro", "2 s"],
)
def test_where_nothing_shows_it_is_taken_for_driven(record):
    told = origin_of([record])
    assert (told.is_driven, told.is_assumed) == (True, True)


@pytest.mark.nightly
def test_a_low_passed_attitude_that_follows_each_frequency_by_another_delay_is_no_own_one():
    # its low-pass cuts just where the motion ends, so that by its gain alone it follows all but the gyros' noise
    told = script("attitude_origin")["driven_case"](34_202, "driven")
    assert not told["own"], told["why"]


def test_what_a_format_documents_is_believed():
    for documented in (True, False):
        told = origin_of([logged()], documented=documented)
        assert (told.is_driven, told.is_assumed) == (documented, False)


def test_several_stretches_are_asked_together():
    whole = logged()
    parts = [whole.between(0.0, 25.0), whole.between(26.0, 59.0)]
    assert not origin_of(parts).is_driven
    assert origin_of([*parts, logged(tau=5.0)]).is_driven


@pytest.mark.parametrize("every", [1, 2, 3, 5])
def test_an_interpolated_angle_tells_of_frequencies_below_half_the_rate_at_which_it_is_new(every):
    """A straight line between two readings bends at one sample in `every`; of readings that are all new at none."""
    samples = np.random.default_rng(1).standard_normal((3000, 6))
    rows = np.arange(3000)
    for column in (3, 4, 5):
        samples[:, column] = np.interp(rows, rows[::every], samples[::every, column])
    spectra = spectra_of([gb.Record(samples, channels=[*GYROS, *ATTITUDE], sample_period_s=0.02)])
    highest_hz = 0.9 * 25.0 if every == 1 else 0.8 * 25.0 / (2 * every)
    assert spectra["p"].highest_hz == pytest.approx(highest_hz, rel=0.1)


@pytest.mark.parametrize("angle", ["phi", "theta"])
def test_beyond_sixty_degrees_nothing_is_told(angle):
    samples = np.random.default_rng(1).standard_normal((3000, 6))
    for lean_deg, told in ((52.0, {*GYROS}), (68.0, set())):
        record = gb.Record(samples, channels=[*GYROS, *ATTITUDE], sample_period_s=0.02)
        assert {*spectra_of([record.replace(angle, record[angle] + lean_deg)])} == told


def test_the_quieter_half_holds_the_window_in_the_middle():
    power = np.array([4.0, 1.0, 3.0, 2.0, 5.0])
    quiet, loud = RateSpectra(
        frequency_hz=np.ones(1),
        gyro=np.sqrt(power)[:, np.newaxis] + 0j,
        rate=np.ones((5, 1)) + 0j,
        scale=np.ones(1),
        highest_hz=1.0,
        quantum=0.0,
    ).halves
    assert quiet.tolist() == [False, True, True, True, False]
    assert (loud == ~quiet).all()


STEP_HZ = 0.5
HZ = np.arange(0.0, 50.5, STEP_HZ)


def followed(share, *, hz=HZ, late_s=0.0, noise=0.0, motion=0.0, level=1.0, quantum=0.0, windows=40):
    """Return spectra: of a gyro's noise the rate has a share, of its motion all; and noise of its own."""
    random = np.random.default_rng(1)
    wave, own, apart = (random.standard_normal((2, windows, len(hz))) for _ in range(3))
    gyro, moved, other = (real + 1j * imaginary for real, imaginary in (wave, own, apart))
    delay = np.exp(-2j * np.pi * hz * late_s)
    return RateSpectra(
        frequency_hz=hz,
        gyro=level * gyro + motion * moved,
        rate=(share * level * gyro + motion * moved) * delay + noise * other,
        scale=np.full(len(hz), 0.25),
        highest_hz=45.0,
        quantum=quantum,
    )


EVERY = np.ones(40, dtype=bool)


@pytest.mark.parametrize("share", [1.0, 0.6, 0.0])
def test_a_gain_is_the_regression_at_the_best_delay_with_its_standard_error(share):
    spectra = followed(share, late_s=0.05, noise=0.2)
    gain, rows = spectra.gain(10.0, 20.0, EVERY), 40 * 20
    assert gain.value == pytest.approx(share, abs=6.0 * gain.deviation)
    assert gain.deviation == pytest.approx(0.2 / np.sqrt(rows), rel=0.1)
    assert gain.density == pytest.approx(0.25 * 2.0, rel=0.1)
    assert gain.of_density == pytest.approx(np.sqrt(2.0 / rows))
    if share:
        assert spectra.late_s(10.0, 20.0, EVERY, 0.001) == pytest.approx(0.05, abs=0.0015)
        assert spectra.gain_at(10.0, 20.0, EVERY, 0.05) == pytest.approx(share, abs=0.05)
        # delays are tried in eighths of the band's shortest period, of which this is one
        assert gain.value == pytest.approx(spectra.gain_at(10.0, 20.0, EVERY, 0.05), rel=2e-3)
    assert spectra.gain(10.0, 20.0, np.arange(40) < 3) is None
    assert followed(share, level=0.0).gain(10.0, 20.0, EVERY) is None


class Told:
    """Spectra that say of every band what they are told to, and note how finely a delay is asked for."""

    halves = (EVERY[:20], EVERY[20:])

    def __init__(self, gain, at_one_delay=0.0):
        self.at_one_delay, self.steps_s = at_one_delay, []
        self.gain = lambda *_: gain
        self.frequency_hz, self.highest_hz = HZ, 45.0

    def late_s(self, low_hz, high_hz, windows, step_s):
        self.steps_s.append(step_s)
        return 0.0

    def gain_at(self, *_):
        return self.at_one_delay


def gain(value, deviation=0.0, density=1.0, of_density=0.0):
    return Gain(value=value, deviation=deviation, density=density, of_density=of_density)


@pytest.mark.parametrize(
    ("share", "deviation", "of_density", "within"),
    [
        (1.0, 0.0, 1e-6, 0.05),  # of noise alone nothing is followed, to a twentieth
        (0.4, 0.0, 1e-6, 0.08),  # and of motion to as much of it again
        (0.4, 0.03, 0.1, 0.18),  # and to two errors, of the gain and of how much is noise
        (2.0, 0.0, 1e-6, 0.05),  # more noise than there is power is all of it
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_beside_noise_that_is_missing_a_rate_follows_all_the_rest(share, deviation, of_density, within, sign):
    for times, agrees in ((0.99, True), (1.01, False)):
        excess, motion = sign * times * within, max(1.0 - share, 0.0)
        told = _beside(Told(gain(motion + excess, deviation, 1.0, of_density)), (10.0, 20.0), EVERY, share)
        assert (told.agrees, told.motion) == (agrees, pytest.approx(motion))
        assert told.excess == pytest.approx(excess / min(share, 1.0))
        if deviation:  # it weighs as it is sure, by 1 / variance
            assert told.weight == pytest.approx(0.4**2 / (0.03**2 + (0.4 * 0.1) ** 2))


def test_a_band_tells_nothing_whose_gain_is_unsure_by_a_tenth_or_more():
    assert _beside(Told(gain(0.5, 0.099)), (10.0, 20.0), EVERY, 0.5) is not None
    assert _beside(Told(gain(0.5, 0.101)), (10.0, 20.0), EVERY, 0.5) is None
    assert _beside(Told(None), (10.0, 20.0), EVERY, 0.5) is None


@pytest.mark.parametrize(("left", "is_so"), [(0.151, True), (0.149, False)])
def test_a_rate_is_equally_late_that_a_delay_of_its_own_fits_little_better(left, is_so):
    """By a twentieth of 0.2 and five errors of 0.008; a delay is asked for to a sixteenth of the shortest period."""
    bands = Told(gain(0.2, 0.008), at_one_delay=left), [(1.0, 2.0), (2.0, 4.0)]
    assert _is_equally_late(*bands) == is_so
    assert bands[0].steps_s == [1.0 / (16.0 * 4.0)]
    assert _is_equally_late(Told(None), bands[1])


SLOW = np.where(HZ < 11.25, 10.0, 0.0)  # motion: an octave and a half below the noise that is looked for
HIGH = HZ >= 22.5


@pytest.mark.parametrize(
    ("given", "low_hz"),
    [
        ({}, 22.5),
        ({"late_s": 0.05}, 22.5),
        ({"share": 0.09 * HIGH}, 22.5),
        ({"share": 0.11 * HIGH}, 15.91),  # in the highest octave a tenth, within two standard errors
        ({"share": 0.3 * (HZ < 22.5)}, None),  # further down noise is followed
        ({"quantum": 8.5}, 22.5),
        ({"quantum": 8.8}, None),  # of steps of a the noise's density is a^2 / 12 over half the rate: a quarter of it
        ({"level": np.where(HZ < 31.8, 1.0, 1.2**0.5)}, 22.5),
        ({"level": np.where(HZ < 31.8, 1.0, 1.4**0.5)}, None),  # no noise: it isn't flat
        ({"motion": np.where((HZ > 11.3) & (HZ < 15.9), 2.0, SLOW)}, 22.5),
        ({"motion": np.where((HZ > 11.3) & (HZ < 15.9), 2.0, SLOW), "late_s": np.where(HZ < 11.25, 0.0, 0.012)}, None),
        ({"motion": 0.0}, None),  # that the rate follows anything isn't seen
    ],
    ids=range(12),
)
def test_a_gyros_noise_is_missing_where_less_than_a_tenth_of_it_is_followed_and_all_of_the_motion(given, low_hz):
    found = _missing(followed(**{"share": 0.0, "noise": 0.3, "motion": SLOW, "windows": 80} | given))
    assert (found and found.low_hz) == pytest.approx(low_hz, abs=0.01)
    if low_hz == 22.5:
        assert found.high_hz == pytest.approx(45.0)
        assert found.share == pytest.approx(1.0 - np.max(given.get("share", 0.0)), abs=0.03)


def test_of_three_half_octaves_the_lowest_is_motion_and_below_90_hz_nothing_is_missing():
    few = np.arange(0.0, 51.0, 5.0)
    motion = np.select([few < 15.0, few < 22.5], [30.0, 2.7])  # what tells quiet from loud windows is further down
    assert _missing(followed(0.0, hz=few, motion=motion, windows=20_000)).low_hz == pytest.approx(22.5)
    for top, is_found in ((45.0, True), (44.5, False)):
        some = slice(0, round(top / STEP_HZ) + 1)
        told = _missing(followed(0.0, hz=HZ[some], motion=SLOW[some], noise=0.3, windows=80))
        assert (told is not None) == is_found


@pytest.mark.parametrize(("top_hz", "low_hz"), [(90.5, 15.91), (89.5, None)])
def test_up_to_180_hz_noise_is_flat_up_to_the_highest_band(top_hz, low_hz):
    """Else what moves in there may be folded, and what is missing below it, too."""
    hz = np.arange(0.0, top_hz + 0.1, STEP_HZ)
    motion = np.select([hz < 7.9, hz > 31.8], [10.0, 1.0])
    found = _missing(followed(0.0, hz=hz, motion=motion, noise=0.3, windows=80))
    assert (found and found.low_hz) == pytest.approx(low_hz, abs=0.01)


def test_an_attitude_may_bend_if_a_format_says_so_or_every_gyro_stands_in_its_rate():
    told = origin_of([logged(tau=1.0)])
    assert (told.may_bend, set(told.shares)) == (True, set(GYROS))
    assert max(told.shares.values()) < 0.3
    assert origin_of([logged()], documented=True).may_bend
    assert not origin_of([logged().between(0.0, 2.0)]).may_bend
    assert not origin_of([logged()]).may_bend


def test_what_stands_of_a_gyro_is_told_by_the_highest_octave_where_most_of_it_does():
    """Where its standard error is below 0.15; where that is more, further down."""
    for told, left in ((0.8, 0.2), (1.1, 0.0), (0.51, 0.49), (0.49, None)):
        assert _standing(Told(gain(told, 0.149))) == (left and pytest.approx(left))
        assert _standing(Told(gain(told, 0.151))) is None
    halves = np.where(HZ < 31.8, 0.9, 0.7)  # the means over an octave's 19 and 26 frequencies
    assert _standing(followed(halves, noise=0.05)) == pytest.approx(1.0 - (19 * 0.9 + 26 * 0.7) / 45, abs=0.03)
    assert _standing(followed(0.8, noise=np.where(HZ < 15.0, 0.05, 9.0))) == pytest.approx(0.2, abs=0.03)
