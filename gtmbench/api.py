"""Everything public: what `import gtmbench as gb` gives. Each name is imported when it is first asked for."""

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtmbench.bench.aircraft import Aircraft
    from gtmbench.bench.attitude_filter import filtered_attitude
    from gtmbench.bench.autopilot import Autopilot, Trim
    from gtmbench.bench.excitation import Excitation
    from gtmbench.bench.flight import fly, trim
    from gtmbench.bench.known_aircraft import load_aircraft
    from gtmbench.bench.loop import Accommodation, Controller, fly_in_loop
    from gtmbench.bench.loop_flight import ControllerError, LoopEvent, LoopFlight
    from gtmbench.bench.modes import LinearModel, Mode, linearised, modes
    from gtmbench.bench.other_sensors import Gps, Magnetometer, with_gps, with_magnetometer
    from gtmbench.bench.sensor_chain import SensorChain, SensorPath
    from gtmbench.bench.sensor_readings import Readings
    from gtmbench.bench.sensors import Imperfections, imperfect, measure
    from gtmbench.bench.simulation import Simulation
    from gtmbench.bench.tuning import Tuned, find_autopilot
    from gtmbench.detectors.accommodation.without_sensor import Accommodate
    from gtmbench.detectors.alarm import Alarm, Judgement
    from gtmbench.detectors.bank.bank import Bank, load_bank
    from gtmbench.detectors.bank.detectability import Signatures, signatures
    from gtmbench.detectors.bank_detector import BankDetector, BankMonitor, calibrate
    from gtmbench.detectors.base import BaseMonitor, FunctionDetector, SimpleDetector
    from gtmbench.detectors.monitor_file import load_monitor, save_monitor
    from gtmbench.detectors.protocol import Detector, Monitor, Score, Stream, Watch, watch
    from gtmbench.detectors.registry import find_detector
    from gtmbench.detectors.score_detector import ScoreDetector
    from gtmbench.detectors.surfaces.in_loop import WatchSurfaces
    from gtmbench.detectors.surfaces.surfaces import SurfaceDetector, SurfaceMonitor, SurfaceSizes
    from gtmbench.detectors.windowed_norm import DissertationOperator, NormMonitor
    from gtmbench.engine.course.detector import CrossCheck, CrossCheckMonitor
    from gtmbench.errors import (
        ConvergenceWarning,
        EnvelopeError,
        GtmbenchError,
        InputError,
        NoteWarning,
        RankWarning,
        TrimError,
    )
    from gtmbench.export.write import Exported, export_c
    from gtmbench.faults.fault import Fault, inject
    from gtmbench.faults.kinds.additive import (
        Bias,
        Drift,
        GSensitivity,
        Noise,
        Oscillation,
        RandomWalk,
        Spikes,
        ThermalBias,
    )
    from gtmbench.faults.kinds.replacing import ClockSlip, Delay, Dropout, Float, Hardover, Jam, Stale, Stuck, Swap
    from gtmbench.faults.kinds.shaping import (
        Deadzone,
        Hysteresis,
        Lag,
        Misalignment,
        Quantisation,
        RateSaturation,
        Saturation,
        ScaleDrift,
        ScaleFactor,
        SignFlip,
    )
    from gtmbench.faults.parameter import Intermittent, flag, other_channel, random_seed, setting, severity
    from gtmbench.faults.registry import fault, register_fault
    from gtmbench.faults.shape import Shape, Typical
    from gtmbench.files.logs import read_log, write_log
    from gtmbench.intake.contents import LogColumn, log_columns
    from gtmbench.intake.events import Event, EventKind
    from gtmbench.intake.flight_log import FlightLog, Remark, Unread
    from gtmbench.intake.imus import Imu
    from gtmbench.intake.open import open_log
    from gtmbench.intake.published_failures import Injection
    from gtmbench.intake.resampling import decimate
    from gtmbench.link.events import LiveEvent, LiveKind
    from gtmbench.link.live import Live, live
    from gtmbench.link.sending import send_live
    from gtmbench.link.watched_link import LinkCounts
    from gtmbench.log.breaking.inject import ChangedColumn, inject_log
    from gtmbench.log.live_watch import watch_live
    from gtmbench.log.truth.score import ScoredLog, score_log
    from gtmbench.log.watch import bank_between, watch_log
    from gtmbench.log.watched_log import WatchedLog
    from gtmbench.method.estimators.bayesian import Bayesian
    from gtmbench.method.estimators.least_squares import InstrumentalVariables, LeastSquares
    from gtmbench.method.estimators.prediction_error import PredictionError
    from gtmbench.method.estimators.total_least_squares import TotalLeastSquares
    from gtmbench.method.filters import NoiseModel
    from gtmbench.method.identify import identify
    from gtmbench.method.magnetometer_witness import FieldOpinion, HeadingWitness
    from gtmbench.method.online import RecursiveIdentification
    from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, PseudoInput, derivable, derive
    from gtmbench.method.residual import (
        Alarms,
        Residual,
        WindowedNorm,
        alarms,
        innovations,
        residual,
        threshold,
        windowed_norm,
    )
    from gtmbench.method.residual_stream import AlarmStream, NormStream, ResidualStream
    from gtmbench.method.selection.inputs import ExcitationCount, InputChoice, count_excitations, select_inputs
    from gtmbench.method.selection.orders import OrderChoice, select_orders
    from gtmbench.method.transmissibility import Transmissibility
    from gtmbench.report.figures.plot import plot
    from gtmbench.report.fleet_report import watch_fleet
    from gtmbench.report.recording.read import read_recording
    from gtmbench.study.campaign.conduct import campaign
    from gtmbench.study.campaign.plan import Campaign, load_campaign
    from gtmbench.study.reference import detection_reference
    from gtmbench.study.run import run, run_study
    from gtmbench.study.scenario import Scenario, load_scenario
    from gtmbench.study.score import Verdict, score
    from gtmbench.study.trial import Baseline, Study, Trial
    from gtmbench.values.attitude_estimators import AttitudeEstimator
    from gtmbench.values.channels import CHANNELS, Channel
    from gtmbench.values.ranges import OutOfRange
    from gtmbench.values.record import Record
    from gtmbench.verdict.verdict import Outcome
else:

    def __getattr__(name: str) -> object:
        """Import a public name, from where the lines above say: all of them take a third of a second."""
        from importlib import import_module

        if name not in __all__:
            raise AttributeError(f"module 'gtmbench' has no attribute '{name}'")
        found = globals()[name] = getattr(import_module(_modules()[name]), name)
        return found

    def __dir__() -> list[str]:
        """Return the public names, beside what every module has."""
        return [*globals(), *__all__]

    @cache
    def _modules() -> dict[str, str]:
        """Return where each public name is defined, by the imports of this very file."""
        import ast
        from pathlib import Path

        tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        return {each.name: node.module for node in imports for each in node.names}


__all__ = [
    "CHANNELS",
    "PSEUDO_INPUTS",
    "Accommodate",
    "Accommodation",
    "Aircraft",
    "Alarm",
    "AlarmStream",
    "Alarms",
    "AttitudeEstimator",
    "Autopilot",
    "Bank",
    "BankDetector",
    "BankMonitor",
    "BaseMonitor",
    "Baseline",
    "Bayesian",
    "Bias",
    "Campaign",
    "ChangedColumn",
    "Channel",
    "ClockSlip",
    "Controller",
    "ControllerError",
    "ConvergenceWarning",
    "CrossCheck",
    "CrossCheckMonitor",
    "Deadzone",
    "Delay",
    "Detector",
    "DissertationOperator",
    "Drift",
    "Dropout",
    "EnvelopeError",
    "Event",
    "EventKind",
    "Excitation",
    "ExcitationCount",
    "Exported",
    "Fault",
    "FieldOpinion",
    "FlightLog",
    "Float",
    "FunctionDetector",
    "GSensitivity",
    "Gps",
    "GtmbenchError",
    "Hardover",
    "HeadingWitness",
    "Hysteresis",
    "Imperfections",
    "Imu",
    "Injection",
    "InputChoice",
    "InputError",
    "InstrumentalVariables",
    "Intermittent",
    "Jam",
    "Judgement",
    "Lag",
    "LeastSquares",
    "LinearModel",
    "LinkCounts",
    "Live",
    "LiveEvent",
    "LiveKind",
    "LogColumn",
    "LoopEvent",
    "LoopFlight",
    "Magnetometer",
    "Misalignment",
    "Mode",
    "Monitor",
    "Noise",
    "NoiseModel",
    "NormMonitor",
    "NormStream",
    "NoteWarning",
    "OrderChoice",
    "Oscillation",
    "OutOfRange",
    "Outcome",
    "PredictionError",
    "PseudoInput",
    "Quantisation",
    "RandomWalk",
    "RankWarning",
    "RateSaturation",
    "Readings",
    "Record",
    "RecursiveIdentification",
    "Remark",
    "Residual",
    "ResidualStream",
    "Saturation",
    "ScaleDrift",
    "ScaleFactor",
    "Scenario",
    "Score",
    "ScoreDetector",
    "ScoredLog",
    "SensorChain",
    "SensorPath",
    "Shape",
    "SignFlip",
    "Signatures",
    "SimpleDetector",
    "Simulation",
    "Spikes",
    "Stale",
    "Stream",
    "Stuck",
    "Study",
    "SurfaceDetector",
    "SurfaceMonitor",
    "SurfaceSizes",
    "Swap",
    "ThermalBias",
    "TotalLeastSquares",
    "Transmissibility",
    "Trial",
    "Trim",
    "TrimError",
    "Tuned",
    "Typical",
    "Unread",
    "Verdict",
    "Watch",
    "WatchSurfaces",
    "WatchedLog",
    "WindowedNorm",
    "alarms",
    "bank_between",
    "calibrate",
    "campaign",
    "count_excitations",
    "decimate",
    "derivable",
    "derive",
    "detection_reference",
    "export_c",
    "fault",
    "filtered_attitude",
    "find_autopilot",
    "find_detector",
    "flag",
    "fly",
    "fly_in_loop",
    "identify",
    "imperfect",
    "inject",
    "inject_log",
    "innovations",
    "linearised",
    "live",
    "load_aircraft",
    "load_bank",
    "load_campaign",
    "load_monitor",
    "load_scenario",
    "log_columns",
    "measure",
    "modes",
    "open_log",
    "other_channel",
    "plot",
    "random_seed",
    "read_log",
    "read_recording",
    "register_fault",
    "residual",
    "run",
    "run_study",
    "save_monitor",
    "score",
    "score_log",
    "select_inputs",
    "select_orders",
    "send_live",
    "setting",
    "severity",
    "signatures",
    "threshold",
    "trim",
    "watch",
    "watch_fleet",
    "watch_live",
    "watch_log",
    "windowed_norm",
    "with_gps",
    "with_magnetometer",
    "write_log",
]
