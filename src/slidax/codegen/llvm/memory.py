"""Write LLVM IR that loads inputs from memory, and stores outputs and log rows.

A lane is one of the runs that are computed in parallel; it is inactive while only other runs take a branch or iterate.
In a `Vector`, a lane is one of several scalars of one run.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir import Program, Type, Value
from .operations import BYTES, STORED, Lines, literal, suffix, type_name


def load_addresses(program: Program, out: Lines) -> None:
    """Write LLVM IR that loads the addresses of all inputs and outputs into `%in0`, `%in1`, ..., `%out0`, ..."""
    names = [f"%in{k}" for k in range(len(program.inputs))] + [f"%out{k}" for k in range(len(program.outputs))]
    for k, name in enumerate(names):
        out.write(f"{name}a = getelementptr ptr, ptr %table, i64 {k}")
        out.write(f"{name} = load ptr, ptr {name}a, !invariant.load !0")


def allocate_spare(program: Program, lanes: int, out: Lines) -> None:
    """Write LLVM IR that allocates a spare row on the stack; inactive lanes write to it instead of to their log."""
    sizes = [output.size * BYTES[output.type] for output in program.outputs if output.values is None]
    if lanes > 1 and sizes:
        out.write(f"%spare = alloca [{max(*sizes, 8)} x i8], align 8")


def read(program: Program, value: Value, index: str, lanes: int, wide: bool, mask: str, out: Lines) -> None:
    """Write LLVM IR that reads one element of an input, for all lanes.

    - `value`: IR value with the operation `input` or `load`.
    - `index`: LLVM operand with the element's index, a scalar or a vector.
    - `lanes`: number of lanes; 1 reads one number.
    - `wide`: True if `index` is a vector.
    - `mask`: LLVM operand with the active lanes, the only ones whose index is in range; "" for all.
    """
    which = value.data[0] if value.op == "input" else value.data
    entry = program.inputs[which]
    name, stored = f"%v{value.number}", STORED[value.type]
    base = f"%in{which}"
    if lanes == 1:
        out.write(f"{name}p = getelementptr {stored}, ptr {base}, i64 {index}")
        loaded = f"{name}i" if value.type == "b1" else name
        out.write(f"{loaded} = load {stored}, ptr {name}p, !invariant.load !0")
        if value.type == "b1":
            out.write(f"{name} = icmp ne i8 {loaded}, 0")
        return
    if not wide:
        out.write(f"{name}b = getelementptr {stored}, ptr {base}, i64 {index}")
        base = f"{name}b"
        index = literal(0, "i64", lanes)
    elif mask:
        out.write(f"{name}g = select {type_name('b1', lanes)} {mask}, {type_name('i64', lanes)} {index}, "
              f"{type_name('i64', lanes)} zeroinitializer")  # fmt: skip
        index = f"{name}g"
    if entry.varying:
        out.write(f"{name}k = add {type_name('i64', lanes)} {index}, {_every(entry.size, lanes)}")
        index = f"{name}k"
    out.write(f"{name}p = getelementptr {stored}, ptr {base}, <{lanes} x i64> {index}")
    loaded = f"{name}i" if value.type == "b1" else name
    llvm_type = f"<{lanes} x {stored}>"
    function = f"llvm.masked.gather.{suffix(value.type, lanes)}.v{lanes}p0"
    where = (f"<{lanes} x ptr>", f"align {BYTES[value.type]} {name}p")
    out.call(
        loaded, llvm_type, function, where, (type_name("b1", lanes), literal(1, "b1", lanes)), (llvm_type, "poison")
    )
    if value.type == "b1":
        out.write(f"{name} = icmp ne {llvm_type} {loaded}, zeroinitializer")


def read_vector(value: Value, lanes: int, out: Lines) -> None:
    """Write LLVM IR that reads consecutive elements of an input as one vector, all of the same run.

    - `value`: a `Vector` that is an input; its `data` are the indices of the input and of the first element.
    - `lanes`: number of elements.
    """
    (which, element), name, stored = value.data, f"%v{value.number}", STORED[value.type]
    loaded = f"{name}i" if value.type == "b1" else name
    out.write(f"{name}p = getelementptr {stored}, ptr %in{which}, i64 {element}")
    out.write(f"{loaded} = load <{lanes} x {stored}>, ptr {name}p, align {BYTES[value.type]}, !invariant.load !0")
    if value.type == "b1":
        out.write(f"{name} = icmp ne <{lanes} x i8> {loaded}, zeroinitializer")


def write_output(program: Program, which: int, element: int, word: str, lanes: int, out: Lines) -> None:
    """Write LLVM IR that stores one element of an output, for all lanes.

    - `which`, `element`: indices of the output and of the element.
    - `word`: LLVM operand with the element of all lanes.
    """
    output = program.outputs[which]
    name, stored = f"%out{which}e{element}", STORED[output.type]
    llvm_type = stored if lanes == 1 else f"<{lanes} x {stored}>"
    if output.type == "b1":
        out.write(f"{name}i = zext {type_name('b1', lanes)} {word} to {llvm_type}")
        word = f"{name}i"
    out.write(f"{name}b = getelementptr {stored}, ptr %out{which}, i64 {element}")
    if lanes == 1:
        out.write(f"store {stored} {word}, ptr {name}b")
        return
    out.write(f"{name}p = getelementptr {stored}, ptr {name}b, <{lanes} x i64> {_every(output.size, lanes)}")
    function = f"llvm.masked.scatter.{suffix(output.type, lanes)}.v{lanes}p0"
    where = (f"<{lanes} x ptr>", f"align {BYTES[output.type]} {name}p")
    out.call("", "void", function, (llvm_type, word), where, (type_name("b1", lanes), literal(1, "b1", lanes)))


def write_row(
    program: Program, store: Value, row: Sequence[str], mask: str, words: Sequence[str], lanes: int, out: Lines
) -> None:
    """Write LLVM IR that stores one row of a log, for all lanes.

    - `store`: the IR operation `store`.
    - `row`: for each lane, an LLVM operand with the row's index.
    - `mask`: LLVM operand with the active lanes; "" for all.
    - `words`: for each element of the row, an LLVM operand with the element of all lanes.
    """
    output = program.outputs[store.data]
    name, stored, log = f"%w{store.number}", STORED[output.type], f"%out{store.data}"
    addresses = []
    for lane in range(lanes):
        at = f"{name}r{lane}"
        out.write(f"{at}a = mul i64 %rows, {lane}")
        out.write(f"{at}b = add i64 {at}a, {row[lane]}")
        out.write(f"{at}c = mul i64 {at}b, {output.size}")
        out.write(f"{at}{'d' if mask else ''} = getelementptr {stored}, ptr {log}, i64 {at}c")
        if mask:
            out.write(f"{at}w = extractelement <{lanes} x i1> {mask}, i32 {lane}")
            out.write(f"{at} = select i1 {at}w, ptr {at}d, ptr %spare")
        addresses.append(at)
    numbers = list(words)
    if output.type == "b1":
        numbers = [f"{name}z{k}" for k in range(len(words))]
        llvm_type = stored if lanes == 1 else f"<{lanes} x {stored}>"
        for number, word in zip(numbers, words, strict=True):
            out.write(f"{number} = zext {type_name('b1', lanes)} {word} to {llvm_type}")
    done = 0
    while lanes > 1 and len(numbers) - done >= lanes:
        _put_block(name, stored, addresses, numbers[done : done + lanes], done, out)
        done += lanes
    for k in range(done, len(numbers)):
        for lane, address in enumerate(addresses):
            number = numbers[k]
            if lanes > 1:
                number = f"{name}x{k}l{lane}"
                out.write(f"{number} = extractelement <{lanes} x {stored}> {numbers[k]}, i32 {lane}")
            out.write(f"{name}p{k}l{lane} = getelementptr {stored}, ptr {address}, i64 {k}")
            out.write(f"store {stored} {number}, ptr {name}p{k}l{lane}")


def _put_block(
    name: str, stored: Type | str, addresses: Sequence[str], numbers: Sequence[str], first: int, out: Lines
) -> None:
    """Write the store of as many row elements as there are lanes, transposed to one contiguous piece per lane.

    - `addresses`: LLVM operands with the address of the row, for each lane.
    - `numbers`: LLVM operands with the elements, each of all lanes.
    - `first`: index of the first element in the row.
    """
    lanes = len(addresses)
    llvm_type = f"<{lanes} x {stored}>"
    block, half = list(numbers), lanes // 2
    # Transposition by halves: swap the off-diagonal quarters of ever smaller squares.
    while half:
        swapped = list(block)
        low = [k if not k & half else lanes + (k ^ half) for k in range(lanes)]
        high = [k ^ half if not k & half else lanes + k for k in range(lanes)]
        for k in range(lanes):
            if not k & half:
                for to, lanes_of in ((k, low), (k | half, high)):
                    swapped[to] = f"{name}t{first}a{half}k{to}"
                    mask = ", ".join(f"i32 {lane}" for lane in lanes_of)
                    out.write(f"{swapped[to]} = shufflevector {llvm_type} {block[k]}, {llvm_type} {block[k | half]}, "
                          f"<{lanes} x i32> <{mask}>")  # fmt: skip
        block, half = swapped, half // 2
    for lane, (address, piece) in enumerate(zip(addresses, block, strict=True)):
        out.write(f"{name}q{first}l{lane} = getelementptr {stored}, ptr {address}, i64 {first}")
        out.write(f"store {llvm_type} {piece}, ptr {name}q{first}l{lane}, align {1}")


def _every(size: int, lanes: int) -> str:
    return "<" + ", ".join(f"i64 {k * size}" for k in range(lanes)) + ">"
