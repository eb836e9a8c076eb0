"""What GaitEyes offers to Python: listen to the service, replay a recording, explain what a simulation gets wrong.

Every name loads what it needs when it is first used, and nothing before. `docs/api.md` describes them all.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.files import load_calibration as load_calibration
    from daemon.pipeline import Pipeline as Pipeline
    from discrepancy.explanation import Explanation as Explanation
    from discrepancy.finder import explain as explain
    from discrepancy.own_simulation import OwnSimulation as OwnSimulation
    from discrepancy.ports.declared import Act as Act
    from discrepancy.ports.declared import Arrays as Arrays
    from discrepancy.ports.declared import Port as Port
    from discrepancy.ports.declared import PortTerm as PortTerm
    from discrepancy.ports.declared import Rows as Rows
    from discrepancy.ports.declared import Signal as Signal
    from discrepancy.ports.declared import SignalTerm as SignalTerm
    from discrepancy.ports.ode import Ode as Ode
    from discrepancy.ports.ode import Whole as Whole
    from discrepancy.ports.simulation import PortedSimulation as PortedSimulation
    from discrepancy.report.output import write_report as write_report
    from discrepancy.report.wording import headline as headline
    from discrepancy.report.wording import quantity_text as quantity_text
    from discrepancy.simulation import Channels as Channels
    from discrepancy.simulation import Effect as Effect
    from discrepancy.simulation import Parameter as Parameter
    from discrepancy.simulation import Simulation as Simulation
    from discrepancy.simulation import Values as Values
    from discrepancy.verdict import Cause as Cause
    from discrepancy.verdict import Gain as Gain
    from discrepancy.verdict import Quantity as Quantity
    from discrepancy.verdict import Remainder as Remainder
    from discrepancy.verdict import Signature as Signature
    from discrepancy.verdict import Verdict as Verdict
    from drivers.can.listener import CanListener as CanListener
    from drivers.can.listener import listen_can as listen_can
    from drivers.zenoh.listener import Listener as Listener
    from drivers.zenoh.listener import listen as listen
    from drivers.zenoh.settings import Credentials as Credentials
    from gaiteyes.recorded import replay as replay
    from messages import AnkleState as AnkleState
    from messages import Attitude as Attitude
    from messages import BiasAtTemperature as BiasAtTemperature
    from messages import Calibration as Calibration
    from messages import CanBusHealth as CanBusHealth
    from messages import CanState as CanState
    from messages import Covariance3 as Covariance3
    from messages import DepthCalibration as DepthCalibration
    from messages import DepthFrame as DepthFrame
    from messages import DepthScale as DepthScale
    from messages import DepthUnitCalibration as DepthUnitCalibration
    from messages import DeviceCounters as DeviceCounters
    from messages import DropCause as DropCause
    from messages import DroppedFrame as DroppedFrame
    from messages import Estimate as Estimate
    from messages import Frame as Frame
    from messages import FrameHeader as FrameHeader
    from messages import GaitPhase as GaitPhase
    from messages import GroundPlane as GroundPlane
    from messages import Health as Health
    from messages import ImuCalibration as ImuCalibration
    from messages import ImuSample as ImuSample
    from messages import Input as Input
    from messages import Learnt as Learnt
    from messages import Lens as Lens
    from messages import Load as Load
    from messages import LoadLevel as LoadLevel
    from messages import Matrix3 as Matrix3
    from messages import Motion as Motion
    from messages import NextFoothold as NextFoothold
    from messages import Pose as Pose
    from messages import PropagatedGround as PropagatedGround
    from messages import Quaternion as Quaternion
    from messages import Reason as Reason
    from messages import Reconfigured as Reconfigured
    from messages import Refusal as Refusal
    from messages import Residual as Residual
    from messages import Setpoint as Setpoint
    from messages import Side as Side
    from messages import Source as Source
    from messages import Stamp as Stamp
    from messages import Status as Status
    from messages import StereoCalibration as StereoCalibration
    from messages import StereoFrame as StereoFrame
    from messages import Terrain as Terrain
    from messages import TerrainEdge as TerrainEdge
    from messages import TerrainKind as TerrainKind
    from messages import TerrainObstacle as TerrainObstacle
    from messages import Tick as Tick
    from messages import UnitCalibration as UnitCalibration
    from messages import UserError as UserError
    from messages import Vec3 as Vec3
    from messages import WearerHeight as WearerHeight
    from messages import ZenohHealth as ZenohHealth
    from messages.arrays import FloatArray as FloatArray
    from messages.can_estimates import CanEstimate as CanEstimate
    from messages.can_estimates import ReceivedEdge as ReceivedEdge
    from messages.can_estimates import ReceivedFoothold as ReceivedFoothold
    from messages.can_estimates import ReceivedGround as ReceivedGround
    from messages.can_estimates import ReceivedPropagatedGround as ReceivedPropagatedGround
    from messages.can_estimates import ReceivedTerrain as ReceivedTerrain
    from messages.can_receiver import CanReceiver as CanReceiver
    from messages.can_setpoint import ReceivedSetpoint as ReceivedSetpoint
    from messages.can_setpoint import SetpointReceiver as SetpointReceiver
    from messages.json_receiver import Received as Received
    from perception.ground.foothold import FootholdSettings as FootholdSettings
    from systems.own.table import Table as Table

__version__ = "0.1.0"

_HOMES = {
    "explain": "discrepancy.finder",
    "Explanation": "discrepancy.explanation",
    "OwnSimulation": "discrepancy.own_simulation",
    "PortedSimulation": "discrepancy.ports.simulation",
    "Ode": "discrepancy.ports.ode",
    "Whole": "discrepancy.ports.ode",
    "Act": "discrepancy.ports.declared",
    "Arrays": "discrepancy.ports.declared",
    "Rows": "discrepancy.ports.declared",
    "Table": "systems.own.table",
    "Port": "discrepancy.ports.declared",
    "Signal": "discrepancy.ports.declared",
    "PortTerm": "discrepancy.ports.declared",
    "SignalTerm": "discrepancy.ports.declared",
    "Channels": "discrepancy.simulation",
    "Effect": "discrepancy.simulation",
    "Parameter": "discrepancy.simulation",
    "Simulation": "discrepancy.simulation",
    "Values": "discrepancy.simulation",
    "Cause": "discrepancy.verdict",
    "Gain": "discrepancy.verdict",
    "Quantity": "discrepancy.verdict",
    "Remainder": "discrepancy.verdict",
    "Signature": "discrepancy.verdict",
    "Verdict": "discrepancy.verdict",
    "headline": "discrepancy.report.wording",
    "quantity_text": "discrepancy.report.wording",
    "write_report": "discrepancy.report.output",
    "CanListener": "drivers.can.listener",
    "listen_can": "drivers.can.listener",
    "Listener": "drivers.zenoh.listener",
    "listen": "drivers.zenoh.listener",
    "Credentials": "drivers.zenoh.settings",
    "Received": "messages.json_receiver",
    "CanReceiver": "messages.can_receiver",
    "CanEstimate": "messages.can_estimates",
    "ReceivedGround": "messages.can_estimates",
    "ReceivedPropagatedGround": "messages.can_estimates",
    "ReceivedFoothold": "messages.can_estimates",
    "ReceivedTerrain": "messages.can_estimates",
    "ReceivedEdge": "messages.can_estimates",
    "ReceivedSetpoint": "messages.can_setpoint",
    "SetpointReceiver": "messages.can_setpoint",
    "replay": "gaiteyes.recorded",
    "Pipeline": "daemon.pipeline",
    "load_calibration": "calib.files",
    "FootholdSettings": "perception.ground.foothold",
    "FloatArray": "messages.arrays",
    "AnkleState": "messages",
    "Attitude": "messages",
    "BiasAtTemperature": "messages",
    "Calibration": "messages",
    "CanBusHealth": "messages",
    "CanState": "messages",
    "Covariance3": "messages",
    "DepthCalibration": "messages",
    "DepthFrame": "messages",
    "DepthScale": "messages",
    "DepthUnitCalibration": "messages",
    "DeviceCounters": "messages",
    "DropCause": "messages",
    "DroppedFrame": "messages",
    "Estimate": "messages",
    "Frame": "messages",
    "FrameHeader": "messages",
    "GaitPhase": "messages",
    "GroundPlane": "messages",
    "PropagatedGround": "messages",
    "Health": "messages",
    "ImuCalibration": "messages",
    "ImuSample": "messages",
    "Input": "messages",
    "Learnt": "messages",
    "Lens": "messages",
    "Load": "messages",
    "LoadLevel": "messages",
    "Matrix3": "messages",
    "Motion": "messages",
    "NextFoothold": "messages",
    "Pose": "messages",
    "Quaternion": "messages",
    "Reason": "messages",
    "Reconfigured": "messages",
    "Setpoint": "messages",
    "Side": "messages",
    "Refusal": "messages",
    "Residual": "messages",
    "Source": "messages",
    "Stamp": "messages",
    "Status": "messages",
    "StereoCalibration": "messages",
    "StereoFrame": "messages",
    "Terrain": "messages",
    "TerrainEdge": "messages",
    "TerrainKind": "messages",
    "TerrainObstacle": "messages",
    "Tick": "messages",
    "UnitCalibration": "messages",
    "UserError": "messages",
    "Vec3": "messages",
    "WearerHeight": "messages",
    "ZenohHealth": "messages",
}
"""Where each name is defined."""

__all__ = [*_HOMES, "__version__"]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
        globals()[name] = value = getattr(import_module(_HOMES[name]), name)
        return value

    def __dir__() -> list[str]:
        return __all__
