/* player FILE: calls an FMU's library as a script says, on the system for which it was compiled. Prints a line for each reading
 * command, with reals as their 64 bits in hexadecimal, so that no bit is lost. One command per line; a text is the rest of its
 * line:
 *
 *   fmi 2|3           the version, the first command
 *   library TEXT      its file, in UTF-8; loaded at once
 *   token TEXT        GUID or instantiation token
 *   resources TEXT    as this version passes them; NULL before this command
 *   new               frees the instance, if there is one, and creates the next
 *   initialise T
 *   set N vr… M bits… writes M reals to N variables
 *   step T H          T and H as bits, like all reals
 *   real N vr… M      reads; likewise integer, boolean, text
 *   save              gets the state and serialises it
 *   restore           deserialises the bytes and sets the state
 *   unload            frees the instance, unloads the library and forgets the resources
 *
 * Exit code 0, or 1 with a message on stderr. */
#include <inttypes.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmi2.h"
#include "fmu/fmi3.h"

#if defined(_WIN32)
#include <fcntl.h>
#include <io.h>
#include <windows.h>
typedef HMODULE Handle;
typedef FARPROC Address;
#else
#include <dlfcn.h>
typedef void* Handle;
typedef void* Address;
#endif

static int version = 0;
static Handle handle = NULL;
static void* instance = NULL;
static void* state = NULL;
static char* token = NULL;
static char* resources = NULL;
static char* bytes = NULL;
static size_t size = 0;
static const char* command = "";

static void fail(const char* what) {
  fprintf(stderr, "player: %s: %s\n", command, what);
  exit(1);
}

static void* room(size_t n, size_t each) {
  void* memory = calloc(n + 1, each);
  if (memory == NULL) fail("no memory");
  return memory;
}

static void load(const char* file) {
#if defined(_WIN32)
  static wchar_t wide[4096];
  if (MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, file, -1, wide, 4096) == 0) fail("the name is no UTF-8, or too long");
  handle = LoadLibraryW(wide);
  if (handle == NULL) {
    char text[64];
    snprintf(text, sizeof text, "LoadLibrary: error %lu", (unsigned long)GetLastError());
    fail(text);
  }
#else
  handle = dlopen(file, RTLD_NOW | RTLD_LOCAL);
  if (handle == NULL) fail(dlerror());
#endif
}

static void unload(void) {
#if defined(_WIN32)
  if (handle != NULL) FreeLibrary(handle);
#else
  if (handle != NULL) dlclose(handle);
#endif
  handle = NULL;
}

static Address function(const char* name) {
#if defined(_WIN32)
  Address found = GetProcAddress(handle, name);
#else
  Address found = dlsym(handle, name);
#endif
  if (found == NULL) fail(name);
  return found;
}
/* Looks up a function of the library by name; of two with equal parameters, that of the version in use. */
#define FMI(name) ((__typeof__(&name))(void (*)(void))function(#name))
#define EITHER(type, name2, name3) ((type)(void (*)(void))function(version == 2 ? #name2 : #name3))

static void log_2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                  fmi2String format, ...) {
  va_list arguments;
  (void)environment;
  (void)category;
  va_start(arguments, format);
  fprintf(stderr, "%s: status %d: ", name, (int)status);
  vfprintf(stderr, format, arguments);
  fputc('\n', stderr);
  va_end(arguments);
}
static void log_3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
  (void)environment;
  (void)category;
  fprintf(stderr, "status %d: %s\n", (int)status, message);
}

static void check(int status) {
  if (status != 0) {
    char text[32];
    snprintf(text, sizeof text, "status %d", status);
    fail(text);
  }
}

static void free_instance(void) {
  if (instance == NULL) return;
  if (state != NULL) check(EITHER(int (*)(void*, void**), fmi2FreeFMUstate, fmi3FreeFMUState)(instance, &state));
  EITHER(void (*)(void*), fmi2FreeInstance, fmi3FreeInstance)(instance);
  instance = NULL;
  state = NULL;
}

static void new_instance(void) {
  free_instance();
  if (version == 2) {
    static const fmi2CallbackFunctions callbacks = {log_2, calloc, free, NULL, NULL};
    instance = FMI(fmi2Instantiate)("played", fmi2CoSimulation, token, resources, &callbacks, fmi2False, fmi2True);
  } else {
    instance =
        FMI(fmi3InstantiateCoSimulation)("played", token, resources, false, true, false, false, NULL, 0, NULL, log_3, NULL);
  }
  if (instance == NULL) fail("no instance");
}

/* Script */

static char* rest(void) {
  char* text = strtok(NULL, "\r\n");
  if (text == NULL) fail("a text is missing");
  char* copy = room(strlen(text), 1);
  return strcpy(copy, text);
}
static const char* word(void) {
  const char* text = strtok(NULL, " \r\n");
  if (text == NULL) fail("a word is missing");
  return text;
}
static size_t count(void) { return (size_t)strtoull(word(), NULL, 10); }
static double real(void) {
  const uint64_t bits = strtoull(word(), NULL, 16);
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}
static unsigned* references(size_t* n) {
  *n = count();
  unsigned* all = room(*n, sizeof *all);
  for (size_t i = 0; i < *n; ++i) all[i] = (unsigned)count();
  return all;
}

static void initialise(void) {
  const double start = real();
  if (version == 2) {
    check(FMI(fmi2SetupExperiment)(instance, fmi2False, 0, start, fmi2False, 0));
    check(FMI(fmi2EnterInitializationMode)(instance));
  } else {
    check(FMI(fmi3EnterInitializationMode)(instance, false, 0, start, false, 0));
  }
  check(EITHER(int (*)(void*), fmi2ExitInitializationMode, fmi3ExitInitializationMode)(instance));
}

static void step(void) {
  const double now = real(), h = real();
  if (version == 2) {
    check(FMI(fmi2DoStep)(instance, now, h, fmi2True));
  } else {
    bool event = true, terminate = true, early = true;
    double reached = 0;
    check(FMI(fmi3DoStep)(instance, now, h, true, &event, &terminate, &early, &reached));
    if (event || terminate || early) fail("ended early, or wants an event or the end");
  }
}

static void set(void) {
  size_t n = 0;
  unsigned* vr = references(&n);
  const size_t m = count();
  double* values = room(m, sizeof *values);
  for (size_t i = 0; i < m; ++i) values[i] = real();
  if (version == 2) {
    check(FMI(fmi2SetReal)(instance, vr, n, values));
  } else {
    check(FMI(fmi3SetFloat64)(instance, vr, n, values, m));
  }
  free(vr);
  free(values);
}

static void get(void) {
  size_t n = 0;
  unsigned* vr = references(&n);
  const size_t m = count();
  void* values = room(m, 8);
#define GET(name2, name3)                          \
  if (version == 2) {                              \
    check(FMI(name2)(instance, vr, n, values));    \
  } else {                                         \
    check(FMI(name3)(instance, vr, n, values, m)); \
  }
  if (strcmp(command, "real") == 0) {
    GET(fmi2GetReal, fmi3GetFloat64)
    for (size_t i = 0; i < m; ++i) {
      uint64_t bits;
      memcpy(&bits, (const double*)values + i, sizeof bits);
      printf("%016" PRIx64 " ", bits);
    }
  } else if (strcmp(command, "integer") == 0) {
    GET(fmi2GetInteger, fmi3GetInt32)
    for (size_t i = 0; i < m; ++i) printf("%" PRId32 " ", ((const int32_t*)values)[i]);
  } else if (strcmp(command, "boolean") == 0) {
    GET(fmi2GetBoolean, fmi3GetBoolean)
    for (size_t i = 0; i < m; ++i) printf("%d ", version == 2 ? ((const int*)values)[i] : ((const bool*)values)[i]);
  } else {
    GET(fmi2GetString, fmi3GetString)
    for (size_t i = 0; i < m; ++i) printf("%s ", ((const char* const*)values)[i]);
  }
#undef GET
  putchar('\n');
  free(vr);
  free(values);
}

static void save(void) {
  check(EITHER(int (*)(void*, void**), fmi2GetFMUstate, fmi3GetFMUState)(instance, &state));
  check(EITHER(int (*)(void*, void*, size_t*), fmi2SerializedFMUstateSize, fmi3SerializedFMUStateSize)(instance, state, &size));
  free(bytes);
  bytes = room(size, 1);
  check(
      EITHER(int (*)(void*, void*, char*, size_t), fmi2SerializeFMUstate, fmi3SerializeFMUState)(instance, state, bytes, size));
}
static void restore(void) {
  if (state != NULL) check(EITHER(int (*)(void*, void**), fmi2FreeFMUstate, fmi3FreeFMUState)(instance, &state));
  check(EITHER(int (*)(void*, const char*, size_t, void**), fmi2DeSerializeFMUstate, fmi3DeserializeFMUState)(instance, bytes,
                                                                                                              size, &state));
  check(EITHER(int (*)(void*, void*), fmi2SetFMUstate, fmi3SetFMUState)(instance, state));
}

static void run(void) {
  if (strcmp(command, "fmi") == 0) {
    version = (int)count();
  } else if (strcmp(command, "library") == 0) {
    char* file = rest();
    load(file);
    free(file);
  } else if (strcmp(command, "token") == 0) {
    free(token);
    token = rest();
  } else if (strcmp(command, "resources") == 0) {
    free(resources);
    resources = rest();
  } else if (strcmp(command, "new") == 0) {
    new_instance();
  } else if (strcmp(command, "initialise") == 0) {
    initialise();
  } else if (strcmp(command, "set") == 0) {
    set();
  } else if (strcmp(command, "step") == 0) {
    step();
  } else if (strcmp(command, "save") == 0) {
    save();
  } else if (strcmp(command, "restore") == 0) {
    restore();
  } else if (strcmp(command, "unload") == 0) {
    free_instance();
    unload();
    free(resources);
    resources = NULL;
  } else if (strcmp(command, "real") == 0 || strcmp(command, "integer") == 0 || strcmp(command, "boolean") == 0 ||
             strcmp(command, "text") == 0) {
    get();
  } else {
    fail("no such command");
  }
}

int main(int argc, char** argv) {
  static char line[1 << 20];
  FILE* script = argc == 2 ? fopen(argv[1], "rb") : NULL;
  if (script == NULL) fail("expected one argument, the name of a script");
#if defined(_WIN32)
  _setmode(_fileno(stdout), _O_BINARY);
#endif
  while (fgets(line, sizeof line, script) != NULL) {
    command = strtok(line, " \r\n");
    if (command == NULL) command = "an empty line";
    run();
  }
  fclose(script);
  command = "end";
  free_instance();
  unload();
  free(token);
  free(resources);
  free(bytes);
  return 0;
}
