"""Results as pandas data frames."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from ident.display.parameters import Parameter

NEEDED = "A data frame needs pandas: pip install 'multicontact[pandas]'."


def parameters_frame(parameters: Sequence["Parameter"]) -> "pd.DataFrame":
    """Data frame of parameters, indexed by their names, with 95 % intervals that include the set-up.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise InputError(NEEDED) from None
    intervals = np.array([each.interval() for each in parameters]).reshape(-1, 2)
    columns = ("kind", "body", "value", "std", "std_setup", "unit", "model", "expression")
    out: dict[str, Any] = {key: [getattr(each, key) for each in parameters] for key in columns}
    out["model"] = np.array([np.nan if x is None else x for x in out["model"]])
    out |= {"lower": intervals[:, 0], "upper": intervals[:, 1]}
    index = pd.Index([each.name for each in parameters], name="parameter")
    order = [*columns[:5], "lower", "upper", *columns[5:]]
    return pd.DataFrame(out, index=index)[order]
