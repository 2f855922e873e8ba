"""Sensors, which read a run or read inside a control loop; their filters and spectra."""

from .run.sensing.sensor import Sensor as Sensor
from .run.sensing.sensors import Encoder as Encoder, Tachometer as Tachometer, ForceTorque as ForceTorque
from .run.sensing.sensors import ContactForce as ContactForce
from .run.sensing.sensors import StrainGauge as StrainGauge, Accelerometer as Accelerometer, Camera as Camera
from .run.sensing.sensor import Sampler as Sampler
from .run.sensing.lowpass import LowPass as LowPass
from .run.sensing.reading import psd as psd
