"""How the parts of a kernel are compiled: as code of the kernel, and not each once more on its own.

Numba optimises every function with all that is inlined into it, makes machine code of it, and does so again
for each function that calls it. But parts are called by kernels alone. So they are only translated, and the
kernel, into which all of them are linked, is optimised once. That takes half of the time.
"""

from numba import types
from numba.core.codegen import CPUCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from hardspheres.kernel.addresses import TABLE_BYTES


class PartLibrary(CPUCodeLibrary):
    """The code of one part, which is neither optimised with what it calls nor executed."""

    def add_ir_module(self, ir_module):
        """Take in code, and say that the table of addresses is there as a whole: it may be read early."""
        for function in ir_module.functions:
            for argument in [] if function.is_declaration else function.args:
                if argument.name == "arg.s":
                    argument.attributes.dereferenceable = TABLE_BYTES
                    argument.add_attribute("noalias")
        super().add_ir_module(ir_module)

    def finalize(self):
        """Leave everything else to the kernel."""
        self._finalized = True

    def with_what_it_calls(self):
        """Return all libraries that a kernel needs in order to call this part."""
        libraries = {self: None}
        for library in self._linking_libraries:
            libraries |= library.with_what_it_calls() if isinstance(library, PartLibrary) else {library: None}
        return libraries


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    _name = "lowering_of_a_part"

    def run_pass(self, state):
        """Translate a part, and tell its callers what they have to link."""
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        # Numba knows functions by what Python calls, which has to be a built-in one: this takes no arguments.
        translated = state.cr = state.cr._replace(cfunc=[].clear)
        libraries = list(state.library.with_what_it_calls())
        state.targetctx.insert_user_function(translated.cfunc, translated.fndesc, libraries)
        return True


# Stages for what kernels do not have: closures, `with`, expressions of arrays, errors, and so on.
NEEDLESS = {
    "AnnotateTypes",
    "DumpParforDiagnostics",
    "FindLiterallyCalls",
    "InlineClosureLikes",
    "InlineInlinables",
    "InlineOverloads",
    "LiteralPropagationSubPipelinePass",
    "LiteralUnroll",
    "MakeFunctionToJitFunction",
    "NopythonRewrites",
    "RewriteDynamicRaises",
    "RewriteSemanticConstants",
    "WithLifting",
}


class PartCompiler(Compiler):
    """Numba's compiler with fewer stages."""

    def define_pipelines(self):
        """Return the stages of compilation."""
        stages = PassManager("part")
        for stage, what in super().define_pipelines()[0].passes:
            if stage.__name__ not in NEEDLESS:
                stages.add_pass(_Lowering if stage is NativeLowering else stage, what)
        stages.finalize()
        return [stages]


class _Part(CPUDispatcher):
    """A function that kernels call; Python cannot."""

    def get_call_template(self, args, kws):
        """Return the code for arguments of these types; Numba would make one more for each constant."""
        return super().get_call_template([types.unliteral(each) for each in args], kws)


def part(function, **options):
    """Return a function that kernels can call."""
    options |= {"nopython": True, "boundscheck": None, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return _Part(py_func=function, targetoptions=options, pipeline_class=PartCompiler)
