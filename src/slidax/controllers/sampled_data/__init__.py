"""The sampled-data form of every law with a surface `s = ė + φ(t, e)`."""

from .law import SampledData as SampledData
from .recipe import sampled_data as sampled_data
from .recovery import Recovery as Recovery
