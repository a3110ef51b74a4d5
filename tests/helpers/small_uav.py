"""A small electric aircraft, written here: 2 kg, a wing of 1.5 m, a propeller of so little inertia that it is stiff."""

_MASS = """<metrics>
 <wingarea unit="M2">0.45</wingarea><wingspan unit="M">1.5</wingspan><chord unit="M">0.3</chord>
 <location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location>
</metrics>
<mass_balance>
 <ixx unit="KG*M2">0.08</ixx><iyy unit="KG*M2">0.08</iyy><izz unit="KG*M2">0.14</izz>
 <emptywt unit="KG">{mass}</emptywt>
 <location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location>
</mass_balance>
<ground_reactions/>
"""
_MOTOR = """<propulsion><engine file="motor"><feed>0</feed><thruster file="blades">
 <location unit="M"><x>-0.4</x><y>0</y><z>0</z></location>
 <orient unit="DEG"><roll>0</roll><pitch>0</pitch><yaw>0</yaw></orient>
 <sense>1</sense></thruster></engine></propulsion>
"""
_SURFACE = """<channel name="{name}"><aerosurface_scale name="{name} scale"><input>fcs/{name}-cmd-norm</input>
 <range><min>-0.35</min><max>0.35</max></range><output>fcs/{output}</output></aerosurface_scale></channel>
"""
# axis: coefficients of what they multiply; lengths of span (b) and chord (c) as JSBSim has them
_AERO = {
    "LIFT": [(0.25, ()), (4.8, ("aero/alpha-rad",))],
    "DRAG": [(0.03, ()), (0.9, ("aero/alpha-rad", "aero/alpha-rad"))],
    "SIDE": [(-0.4, ("aero/beta-rad",))],
    "ROLL": [
        (-0.06, ("metrics/bw-ft", "aero/beta-rad")),
        (-0.45, ("metrics/bw-ft", "aero/bi2vel", "velocities/p-aero-rad_sec")),
        (0.12, ("metrics/bw-ft", "aero/bi2vel", "velocities/r-aero-rad_sec")),
        (0.15, ("metrics/bw-ft", "fcs/left-aileron-pos-rad")),
    ],
    "PITCH": [
        (0.02, ("metrics/cbarw-ft",)),
        (-0.9, ("metrics/cbarw-ft", "aero/alpha-rad")),
        (-9.0, ("metrics/cbarw-ft", "aero/ci2vel", "velocities/q-aero-rad_sec")),
        (-0.9, ("metrics/cbarw-ft", "fcs/elevator-pos-rad")),
    ],
    "YAW": [
        (0.07, ("metrics/bw-ft", "aero/beta-rad")),
        (-0.12, ("metrics/bw-ft", "aero/bi2vel", "velocities/r-aero-rad_sec")),
    ],
}
_RUDDER = (-0.06, ("metrics/bw-ft", "fcs/rudder-pos-rad"))
POWER_W, DIAMETER_M, CP, CT = 300.0, 0.25, 0.05, 0.1


def write_uav(root, name="smallish", *, rudder=True, motor=True, blades_ixx_kg_m2=4e-6, mass_kg=2.0):
    """Write the model into root/aircraft/NAME and root/engine; return its folder."""
    folder, engines = root / "aircraft" / name, root / "engine"
    folder.mkdir(parents=True)
    engines.mkdir()
    (engines / "motor.xml").write_text(
        f'<?xml version="1.0"?><electric_engine name="motor"><power unit="WATTS">{POWER_W}</power></electric_engine>'
    )
    table = '<table name="{}" type="internal"><tableData>0 {}\n 5 {}</tableData></table>'
    (engines / "blades.xml").write_text(
        f'<?xml version="1.0"?><propeller name="blades"><ixx unit="KG*M2">{blades_ixx_kg_m2}</ixx>'
        f'<diameter unit="M">{DIAMETER_M}</diameter><numblades>2</numblades><gearratio>1</gearratio>'
        f"{table.format('C_THRUST', CT, CT)}{table.format('C_POWER', CP, CP)}</propeller>"
    )
    surfaces = {"elevator": "elevator-pos-rad", "aileron": "left-aileron-pos-rad"}
    aero = {axis: list(terms) for axis, terms in _AERO.items()}
    if rudder:
        surfaces["rudder"] = "rudder-pos-rad"
        aero["YAW"].append(_RUDDER)
    axes = "".join(
        f'<axis name="{axis}">'
        + "".join(_function(f"aero/{axis}{i}", *term) for i, term in enumerate(terms))
        + "</axis>"
        for axis, terms in aero.items()
    )
    control = "".join(_SURFACE.format(name=each, output=output) for each, output in surfaces.items())
    (folder / f"{name}.xml").write_text(
        f'<?xml version="1.0"?><fdm_config name="{name}" version="2.0" release="BETA">'
        f"<fileheader><author>gtmbench</author><description>A small UAV</description></fileheader>"
        f'{_MASS.format(mass=mass_kg)}{_MOTOR if motor else ""}<flight_control name="direct">{control}</flight_control>'
        f"<aerodynamics>{axes}</aerodynamics></fdm_config>"
    )
    return folder


def _function(name, value, factors):
    inside = "".join(f"<property>{each}</property>" for each in ("aero/qbar-psf", "metrics/Sw-sqft", *factors))
    return f'<function name="{name}"><product>{inside}<value>{value}</value></product></function>'
