from . import box as box
from . import forces as forces
from . import laws as laws
from . import observables as observables
from . import state as state
