// A module of another version: program and module must not exchange objects.
struct Module {
  unsigned format;
  const char* version;
};

__attribute__((visibility("default"))) const struct Module* cotwin_unit_module(void) {
  static const struct Module kModule = {1, "0.0.1"};
  return &kModule;
}
