"""Lines of a diagnosis: what was measured, what is expected, and whether it holds."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .expectation import NOTHING, Expectation, above, below, near, said, undeclared
    from .finding import ANY, VERDICTS, Finding
    from .ledger import booked_line, ledger_line
    from .order import EXACT, order_line
    from .solver import solver_line
else:
    __getattr__, __dir__ = lazy_door(__name__)
