"""Sensors: instruments that read a run, or read inside a control loop; their filters and spectra."""

from .run.sensing.lowpass import LowPass as LowPass
from .run.sensing.reading import psd as psd
from .run.sensing.sensor import Sampler as Sampler
from .run.sensing.sensor import Sensor as Sensor
from .run.sensing.sensors import (
    Accelerometer as Accelerometer,
)
from .run.sensing.sensors import (
    Camera as Camera,
)
from .run.sensing.sensors import (
    Encoder as Encoder,
)
from .run.sensing.sensors import (
    ForceTorque as ForceTorque,
)
from .run.sensing.sensors import (
    StrainGauge as StrainGauge,
)
from .run.sensing.sensors import (
    Tachometer as Tachometer,
)
