// Suppressions for the thread sanitizer: the dynamic loader passes memory from one thread's dlopen to another's dlclose under a
// lock that is not instrumented. Every test that runs under the thread sanitizer is linked with this file.
extern "C" __attribute__((visibility("default"))) const char* __tsan_default_suppressions();

extern "C" const char* __tsan_default_suppressions() { return "race:_dl_close_worker\n"; }
