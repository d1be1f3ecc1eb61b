from . import box as box
from . import coin_table as coin_table
from . import forces as forces
from . import ifr as ifr
from . import law as law
from . import observables as observables
from . import state as state
from . import walls as walls
