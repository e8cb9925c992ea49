"""What the aircraft of elastic modes is made of: presets of parameters and noise levels, with their sources."""

from plants.arguments import Parameter

FAMILIES = {"flap": "symmetric", "aileron": "antisymmetric"}  # the modes that a surface moves

NAMED = "assumption: Miller 2012 prints no frequency"
SCALED = "assumption: accelerations of the order of 1 m/s2 for 1 deg, and for 1 m/s of gust"
# frequency Hz, damping, force of the surface m/s2/deg, force of the gust m/s2 per m/s
MODES = {
    "symmetric": ((5.59, 0.030, 0.9, 1.5), (13.98, 0.020, 2.5, 0.8), (16.95, 0.020, 1.6, 0.7)),
    "antisymmetric": (
        (8.15, 0.020, 0.95, 0.5),
        (8.84, 0.025, 1.4, 0.8),
        (12.98, 0.020, -0.95, 0.4),
        (14.85, 0.020, 1.9, 0.6),
        (16.79, 0.025, 1.5, 0.5),
        (18.62, 0.020, -1.15, 0.4),
    ),
}


def _modes(family: str) -> dict[str, Parameter]:
    found = {}
    for i, (frequency, damping, force, gust) in enumerate(MODES[family], 1):
        found[f"{family}_{i}_frequency"] = Parameter(frequency, "Hz", NAMED)
        found[f"{family}_{i}_damping"] = Parameter(damping, "1", "assumption: between 0.01 and 0.03")
        found[f"{family}_{i}_force"] = Parameter(force, "m/s2/deg", SCALED, "any")
        found[f"{family}_{i}_gust"] = Parameter(gust, "1/s", SCALED, "any")
    return found


COMMON = {
    "outputs": Parameter(94, "1", "Miller 2012, 6.2.1; of fewer, the sensors with most signal are kept"),
    "speed": Parameter(273.0, "m/s", "assumption: Mach 0.85 at 4600 m"),
    "turbulence_length": Parameter(533.0, "m", "MIL-F-8785C: 1750 ft above 2000 ft"),
}
FLAP = {
    "flap_slow_pole": Parameter(26.9, "rad/s", "assumption: servo of the F/A-18, from memory"),
    "flap_fast_pole": Parameter(82.9, "rad/s", "assumption: servo of the F/A-18, from memory"),
    "flap_rate": Parameter(15.0, "deg/s", "assumption: servo of the F/A-18, from memory"),
    "flap_travel": Parameter(3.0, "deg", "assumption: -3 to 33 deg; from trim to the nearer stop"),
    "flap_gust": Parameter(0.2, "deg s/m", "assumption: the servo gives way under gust loads", "any"),
    **_modes("symmetric"),
}
AILERON = {
    "aileron_frequency": Parameter(75.0, "rad/s", "assumption: servo of the F/A-18, from memory"),
    "aileron_damping": Parameter(0.59, "1", "assumption: servo of the F/A-18, from memory"),
    "aileron_rate": Parameter(100.0, "deg/s", "assumption: servo of the F/A-18, from memory"),
    "aileron_travel": Parameter(25.0, "deg", "assumption: -25 to 42 deg; one aileron goes up, the other down"),
    "aileron_gust": Parameter(0.2, "deg s/m", "assumption: the servo gives way under gust loads", "any"),
    **_modes("antisymmetric"),
    "roll_time_constant": Parameter(0.4, "s", "assumption"),
    "roll_effectiveness": Parameter(15.0, "1/s2", "assumption: deg/s2 for a degree of aileron"),
    "roll_gust": Parameter(1.0, "deg/(s m)", "assumption: deg/s2 for 1 m/s", "any"),
    "gyro_elastic": Parameter(1.0, "deg/m", "assumption: slope of every mode where the gyro sits", "any"),
    "feedback_gain": Parameter(0.3, "s", "assumption: degrees of aileron for a deg/s of roll rate"),
    "feedback_lag": Parameter(0.05, "s", "assumption"),
}


PRESETS = {"flap": COMMON | FLAP, "aileron": COMMON | AILERON, "combined": COMMON | FLAP | AILERON}
DESCRIPTIONS = {
    "flap": "elastic aircraft in gusts: collective leading-edge flap to accelerometers and taps, open loop",
    "aileron": "elastic aircraft in gusts: differential aileron to accelerometers and taps, roll-rate feedback",
    "combined": "elastic aircraft in gusts: flap and aileron to accelerometers and taps, roll-rate feedback",
}
NOISE = {
    "gust": Parameter(0.5, "m/s", "assumption: light turbulence, rms of the vertical speed"),
    "accelerometers": Parameter(0.05, "m/s2", "assumption"),
    "taps": Parameter(20.0, "Pa", "assumption"),
    "gyro": Parameter(0.1, "deg/s", "assumption"),
    "positions": Parameter(0.02, "deg", "assumption: of the order of a transducer's resolution"),
}
EXCITED = {"flap": 0.35, "aileron": 0.8}  # rms of the commands by which sensors are ranked, deg: an assumption
