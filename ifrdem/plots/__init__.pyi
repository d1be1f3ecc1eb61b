from .run import cooling as cooling
from .run import driven as driven
from .run import sheared as sheared
from .run import walled as walled
