"""Where the example survey lies, and measuring frames for it."""

from quantify_client.crs import Frame, measuring_frame
from quantify_client.types import Bounds

UTM15 = "EPSG:32615"
BESSEL = "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7 +no_defs"
BEACH = Bounds(576661.975, 5188114.06, 156.06, 576768.247, 5188211.70, 168.92)
BEACH_DEGREES = Bounds(-91.997, 46.842, 156.0, -91.995, 46.844, 169.0)


def frame_of(crs, source_unit=None, bounds=BEACH) -> Frame:
    return measuring_frame(crs, source_unit, bounds)
