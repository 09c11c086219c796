from sim_core.compiled_cache import use_own_folder as _use_own_folder

_use_own_folder()
