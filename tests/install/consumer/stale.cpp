// A module of another version: program and module must not exchange objects.
struct Module {
  unsigned format;
  const char* version;
};

extern "C" __attribute__((visibility("default"))) const Module* cotwin_unit_module() {
  static constexpr Module kModule = {1, "0.0.1"};
  return &kModule;
}
