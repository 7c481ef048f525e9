// What the thread sanitizer cannot see: the dynamic loader hands memory of its own from one thread's dlopen to another's
// dlclose, under a lock that is not instrumented. Every test that runs under the thread sanitizer is linked with this.
extern "C" __attribute__((visibility("default"))) const char* __tsan_default_suppressions();

extern "C" const char* __tsan_default_suppressions() { return "race:_dl_close_worker\n"; }
