"""Launches of a kernel with the same arrays again and again: the list of its arguments is made once.

At each call of a kernel a runtime checks all arguments and writes a new list of them, which takes Taichi half a
millisecond for the fifty arrays of a window. On a CPU the list of a launch can be used for the next one. Launches on a
GPU use it up: there it is written again, without checks. Either is done for the versions of runtimes that it was tried
with; with others, and by quadrants on a GPU, a kernel is called as usual.
"""

import operator
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from . import runtime
from .language import on_gpu, program, ti, view
from ..layout import Uses
from .signature import parameters_of

_IS_KNOWN = runtime.is_known()
_INTEGERS = ti.types.primitive_types.integer_type_ids
_IS_TAICHI = runtime.chosen() == "taichi"


class Launcher:
    """One kernel and the list of its arguments.

    Parameters
    ----------
    kernel : kernel
        Its first parameters are numbers, the others arrays, and features (a template argument).
    n_numbers : int
        How many numbers.
    given : collection of str
        Names of the parameters whose arrays differ from launch to launch.

    Attributes
    ----------
    held_names : tuple of str
        Names of the other ones that are no numbers, in order.
    """

    def __init__(self, kernel: Any, n_numbers: int, given: Collection[str]) -> None:
        self._kernel, self._names, self._given = kernel, parameters_of(kernel), frozenset(given)
        self.held_names: tuple[str, ...] = tuple(
            name for name in self._names[n_numbers:] if name not in self._given
        )
        self._held: tuple[Any, ...] = ()
        self._arrays: list[Any] = []  # of the last launch, without given arrays of NumPy
        self._kinds: dict[str, tuple[Any, int]] = {}  # types and axes of those given in the last launch
        self._set_numbers: list[Any] = []
        self._set_given: list[tuple[str, Callable[[Any], None]]] = []
        self._launch: Callable[[], None] | None = None
        self._launch_with: Callable[[tuple[float, ...]], None] | None = None  # on a GPU

    def __call__(self, numbers: tuple[float, ...], held: tuple[Any, ...], given: dict[str, Any]) -> None:
        """Launch the kernel with numbers, the arrays of `held_names`, and `given` ones by name.

        A new list is written unless those held are the same objects as for the last launch.
        """
        arrays = [*held, *(each for each in given.values() if isinstance(each, ti.Ndarray))]
        if (
            (self._launch is None and self._launch_with is None)
            or not all(map(operator.is_, arrays, self._arrays))
            or self._have_changed(given)
        ):
            self._held, self._arrays = held, arrays
            self._launch_first(numbers, given)
            return
        if self._launch_with is not None:
            self._launch_with(numbers)
            return
        for set_number, number in zip(self._set_numbers, numbers, strict=True):
            set_number(number)
        for name, set_array in self._set_given:
            set_array(given[name])
        self._launch()

    def _have_changed(self, given: dict[str, Any]) -> bool:
        """True if arrays are of other types than those of the last launch."""
        return any((given[name].dtype, given[name].ndim) != kind for name, kind in self._kinds.items())

    def _launch_first(self, numbers: tuple[float, ...], given: dict[str, Any]) -> None:
        """Have the runtime check the arguments and launch the kernel; list them for the next launch."""
        self._launch, self._launch_with, held = None, None, iter(self._held)
        arrays = [given[name] if name in self._given else next(held) for name in self._names[len(numbers) :]]
        # Python's: quadrants warns of numbers of NumPy, and checks launches with them again and again.
        numbers = tuple(each.item() if isinstance(each, np.generic) else each for each in numbers)
        ti.lang.impl.current_cfg().opt_level = int(not any(map(_is_long, self._held)))
        self._announce(given)
        self._kernel(*numbers, *arrays)
        if _IS_KNOWN and not on_gpu():
            self._list_arguments((*numbers, *arrays), len(numbers))
        elif _IS_KNOWN and _IS_TAICHI and not any(isinstance(each, np.ndarray) for each in arrays):
            self._list_on_gpu((*numbers, *arrays), len(numbers))

    def _announce(self, given: dict[str, Any]) -> None:
        """Announce the kernel if it has not been launched with such features and types."""
        uses = [each for each in self._held if isinstance(each, Uses)]
        kinds = [(each.dtype, each.ndim) for each in given.values() if isinstance(each, np.ndarray)]
        runtime.announce(self._kernel._primal.func.__name__, (self._kernel, *uses, *kinds))

    def _list_on_gpu(self, arguments: tuple[Any, ...], n_numbers: int) -> None:
        """Note how the arguments of a launch on a GPU, all of them numbers and arrays of Taichi, are listed again."""
        kernel, compiled = _found(self._kernel._primal, arguments)
        numbers, arrays = [], []
        for place, (value, parameter) in enumerate(
            (value, parameter)
            for value, parameter in zip(arguments, self._kernel._primal.arguments, strict=True)
            if not isinstance(parameter.annotation, ti.template)
        ):
            if place < n_numbers:
                numbers.append(((place,), id(parameter.annotation) in _INTEGERS))
            else:
                arrays.append(((place,), value.arr))

        def launch(values: tuple[float, ...]) -> None:
            context = kernel.make_launch_context()
            for (at, is_integer), value in zip(numbers, values, strict=True):
                if is_integer:
                    context.set_arg_int(at, int(value))
                else:
                    context.set_arg_float(at, float(value))
            for at, array in arrays:
                context.set_arg_ndarray(at, array)
            program().launch_kernel(compiled, context)

        self._launch_with = launch

    def _list_arguments(self, arguments: tuple[Any, ...], n_numbers: int) -> None:
        """List the arguments of a launch that has been done."""
        (context, compiled), kinds = _compiled(self._kernel._primal, arguments), {}
        self._set_numbers, self._set_given, place = [], [], 0
        parameters = self._kernel._primal.arguments if _IS_TAICHI else self._kernel._primal.arg_metas
        for i, (name, value, parameter) in enumerate(zip(self._names, arguments, parameters, strict=True)):
            at = (place,) if _IS_TAICHI else place
            if isinstance(parameter.annotation, ti.template):
                continue
            place += 1
            if i < n_numbers:
                self._set_numbers.append(_number_setter(context, at, parameter.annotation))
            elif isinstance(value, ti.Ndarray):
                memory = view(value)
                context.set_arg_external_array_with_shape(
                    at, memory.ctypes.data, memory.nbytes, value.shape, 0
                )
            else:
                set_array = _array_setter(context, at)
                set_array(value)
                if name in self._given:
                    self._set_given.append((name, set_array))
                    kinds[name] = value.dtype, value.ndim
        self._kinds = kinds
        # The program itself is not kept: it has to end where the runtime does.
        self._launch = lambda: program().launch_kernel(compiled, context)


def _is_long(held: Any) -> bool:
    """True for features whose kernels are so long that the runtime shall not look for common terms in a whole kernel.

    The time for that goes with the square of the length: 20 of 23 s for a gas with pistons. LLVM finds nearly as many;
    kernels have some 2 % more instructions then, and the same bits.
    """
    return isinstance(held, Uses) and (held.pistons or held.rest)


def _compiled(primal: Any, arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """A list for the arguments of a kernel that has been launched with these, and its compiled program."""
    if not _IS_TAICHI:
        key = primal._last_launch_key
        return primal.materialized_kernels[key].make_launch_context(), primal.compiled_kernel_data_by_key[key]
    kernel, compiled = _found(primal, arguments)
    return kernel.make_launch_context(), compiled


def _found(primal: Any, arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """A kernel of Taichi that has been launched with these arguments, and its compiled program."""
    kernel = primal.compiled_kernels[primal.func, primal.mapper.lookup(arguments)[0], primal.autodiff_mode]
    present = program()
    return kernel, present.compile_kernel(present.config(), present.get_device_caps(), kernel)


def _number_setter(context: Any, at: Any, annotation: Any) -> Callable[[Any], None]:
    """A function that sets a number in a list of arguments."""
    if id(annotation) in _INTEGERS:
        return lambda number: context.set_arg_int(at, int(number))
    return lambda number: context.set_arg_float(at, float(number))


def _array_setter(context: Any, at: Any) -> Callable[[Any], None]:
    """A function that sets an array of NumPy in a list of arguments."""

    def set_array(array: Any) -> None:
        if not array.flags.c_contiguous:
            raise ValueError("an array of NumPy whose rows do not follow one another")
        address, _ = array.__array_interface__["data"]  # `array.ctypes` is slower
        context.set_arg_external_array_with_shape(at, address, array.nbytes, array.shape, 0)

    return set_array
