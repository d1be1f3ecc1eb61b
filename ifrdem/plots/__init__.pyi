from .impact_angles import impact_scan as impact_scan
from .pictures import figure as figure
from .run import cooling as cooling
from .run import driven as driven
from .run import sheared as sheared
from .run import walled as walled
from .table_friction import table as table
