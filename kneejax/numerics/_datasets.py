"""Results as datasets of xarray, each declared once."""

__all__ = ["Named"]

import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kneejax.numerics._errors import imported
from kneejax.quantities import unit_of_column

if TYPE_CHECKING:
    from xarray import Dataset

_SPELLED = {"Nm": "N m", "Nmm": "N mm"}


class Named:
    """A result whose numbers have named dimensions: what it declares, `to_dataset` gives.

    Attributes:
        OVER: dimensions, blanks between them -> attribute -> its unit: `1` of a plain number, empty
            where its name ends in the unit or where it has none, and of an enumeration its class,
            for words.

    Example:
        >>> import dataclasses
        >>> @dataclasses.dataclass
        ... class Pull(Named):
        ...     force_N: np.ndarray
        ...     OVER = {"pose": {"force_N": ""}}
        >>> found = Pull(np.array([1.0, 2.0])).to_dataset(knee="four_ligament")
        >>> found.force_N.dims, found.force_N.units, found.knee
        (('pose',), 'N', 'four_ligament')
    """

    OVER: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    def _named(self) -> dict[str, tuple]:
        """Name -> dimensions, values and, where the name does not end in it, the unit; labels of a
        dimension stand under its name."""
        return {
            name: (over, getattr(self, name), unit)
            for over, units in self.OVER.items() for name, unit in units.items()
        }  # fmt: skip

    def to_dataset(
        self, attributes: Mapping[str, Any] | None = None, /, **labels: Any
    ) -> "Dataset":
        """The numbers of this result with named dimensions and units.

        Args:
            attributes: of the whole, e.g. the study and the versions.
            **labels: of dimensions whose names the result does not know, as
                `ligament=knee.ligaments.names`; other names become attributes.

        Returns:
            An `xarray.Dataset`; units are the attribute `units` of each variable, or a coordinate
            such as `parameter_unit` where they differ along a dimension. Statuses are words.

        Raises:
            MissingPackage: xarray is not installed; the sentence says what to do.

        Example:
            >>> import kneejax as kj
            >>> knee = kj.load_knee("four_ligament")
            >>> found = kj.evaluate(knee, kj.Pose.from_table([[0, 0, 0, 0, 0.5, 0]]))
            >>> data = found.to_dataset(ligament=knee.ligaments.names)
            >>> data.tension.sel(ligament="ACL").units
            'N'
        """
        content = {name: _variable(name, *one) for name, one in self._named().items()}
        known = {dimension for over, *_ in content.values() for dimension in over}
        own = {name: ([name], list(values)) for name, values in labels.items() if name in known}
        rest = {name: value for name, value in labels.items() if name not in known}
        data = imported("xarray", "xarray", "maps").Dataset(content | own)
        units = [name for name in content if name.endswith("_unit")]
        return data.set_coords(units).assign_attrs(self._about() | dict(attributes or {}) | rest)

    def _about(self) -> dict[str, Any]:
        """Attributes of the whole."""
        return {}


def _variable(name: str, over: str | tuple, values: Any, unit: Any = "") -> tuple:
    """Dimensions, values and attributes as xarray takes them."""
    over = tuple(over.split()) if isinstance(over, str) else over
    if isinstance(unit, enum.EnumMeta):
        kind: Any = unit
        words = [kind(int(one)).word for one in np.asarray(values).ravel()]
        return over, np.reshape(np.array(words, str), np.shape(values)), {}
    attributes = dict(unit) if isinstance(unit, Mapping) else {}
    unit = "" if isinstance(unit, Mapping) else unit or unit_of_column(name)
    units = {"units": _SPELLED.get(unit, unit)} if unit else {}
    return over, np.asarray(values), attributes | units
