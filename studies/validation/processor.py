"""What the kernels are compiled for: the processor and the widest vectors, as Numba and LLVM see them."""

from __future__ import annotations

from llvmlite import binding

__all__ = ["compiled_for", "vectors_of"]

# 512 bits of integers packed by a mask, and 256 bits added: LLVM writes one instruction where there is one.
_PROBE = """
target triple = "{triple}"
declare <16 x i32> @llvm.experimental.vector.compress.v16i32(<16 x i32>, <16 x i1>, <16 x i32>)
define <16 x i32> @pack(<16 x i32> %a, <16 x i1> %m) {{
  %b = call <16 x i32> @llvm.experimental.vector.compress.v16i32(<16 x i32> %a, <16 x i1> %m, <16 x i32> zeroinitializer)
  ret <16 x i32> %b
}}
define <8 x i32> @add(<8 x i32> %a, <8 x i32> %b) {{
  %c = add <8 x i32> %a, %b
  ret <8 x i32> %c
}}
"""  # noqa: E501


def compiled_for() -> tuple[str, str, str]:
    """Return triple, processor and features for which Numba compiles in this process."""
    from numba.core.registry import cpu_target

    triple, processor, features = cpu_target.target_context.codegen().magic_tuple()
    return str(triple), str(processor), str(features)


def vectors_of(triple: str, processor: str, features: str) -> str:
    """Return "AVX-512", "AVX2" or "generic": what LLVM makes vector code of.

    It is read from machine code that LLVM writes: names and features of processors are spelled in many ways.

    Parameters
    ----------
    triple, processor, features : str
        As `compiled_for` gives them.
    """
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_triple(triple)
    machine = target.create_target_machine(cpu=processor, features=features, opt=2)
    code = machine.emit_assembly(binding.parse_assembly(_PROBE.format(triple=triple)))
    if "vpcompressd" in code:
        return "AVX-512"
    return "AVX2" if any("vpaddd" in line and "%ymm" in line for line in code.splitlines()) else "generic"
