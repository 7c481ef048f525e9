// Replacements for functions of newer versions of glibc that COTWIN_FMU_GLIBC (fmu.cmake) lacks and that units, or the C++
// run-time library inside them, use. The library that links them does not export them.
#include <dlfcn.h>
#include <fcntl.h>
#include <link.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>

extern "C" {

/// Since 2.32. False is always correct: reference counts are then changed atomically.
char __libc_single_threaded = 0;

// Since 2.33; before, <sys/stat.h> called __xstat etc. On 64-bit machines the kernel fills glibc's structure.
int fstatat(int folder, const char* path, struct stat* out, int flags) noexcept {
  return static_cast<int>(syscall(SYS_newfstatat, folder, path, out, flags));
}
int stat(const char* path, struct stat* out) noexcept { return fstatat(AT_FDCWD, path, out, 0); }
int lstat(const char* path, struct stat* out) noexcept { return fstatat(AT_FDCWD, path, out, AT_SYMLINK_NOFOLLOW); }
int fstat(int file, struct stat* out) noexcept { return static_cast<int>(syscall(SYS_fstat, file, out)); }

static_assert(sizeof(struct stat) == sizeof(struct stat64));
int fstatat64(int folder, const char* path, struct stat64* out, int flags) noexcept {
  return static_cast<int>(syscall(SYS_newfstatat, folder, path, out, flags));
}
int stat64(const char* path, struct stat64* out) noexcept { return fstatat64(AT_FDCWD, path, out, 0); }
int lstat64(const char* path, struct stat64* out) noexcept { return fstatat64(AT_FDCWD, path, out, AT_SYMLINK_NOFOLLOW); }
int fstat64(int file, struct stat64* out) noexcept { return static_cast<int>(syscall(SYS_fstat, file, out)); }

/// Since 2.36. Called by std::random_device of Debian's cross compiler for ARM.
std::uint32_t arc4random() noexcept {
  std::uint32_t value = 0;
  while (syscall(SYS_getrandom, &value, sizeof value, 0) != sizeof value) {
  }
  return value;
}

#if __GLIBC_PREREQ(2, 35)

namespace {

struct Search {
  std::uintptr_t address;
  dl_find_object* out;
};

/// Callback of dl_iterate_phdr. Fills `out` and returns 1 if the address is in this library.
int find_library(dl_phdr_info* library, std::size_t, void* context) {
  const auto& [address, out] = *static_cast<Search*>(context);
  std::uintptr_t begin = UINTPTR_MAX, end = 0, eh_frame = 0;
  bool inside = false;
  for (int i = 0; i < library->dlpi_phnum; ++i) {
    const ElfW(Phdr)& segment = library->dlpi_phdr[i];
    const std::uintptr_t first = library->dlpi_addr + segment.p_vaddr;
    if (segment.p_type == PT_GNU_EH_FRAME) eh_frame = first;
    if (segment.p_type != PT_LOAD) continue;
    inside = inside || (address >= first && address - first < segment.p_memsz);
    begin = first < begin ? first : begin;
    end = first + segment.p_memsz > end ? first + segment.p_memsz : end;
  }
  if (!inside || eh_frame == 0) return 0;
  *out = {};
  out->dlfo_map_start = reinterpret_cast<void*>(begin);
  out->dlfo_map_end = reinterpret_cast<void*>(end);
  out->dlfo_eh_frame = reinterpret_cast<void*>(eh_frame);
  return 1;
}

}  // namespace

/// Since 2.35. Finds the tables for unwinding the stack. GCC's run-time library calls it for every frame of an exception.
int _dl_find_object(void* address, dl_find_object* out) noexcept {
  Search search{reinterpret_cast<std::uintptr_t>(address), out};
  return dl_iterate_phdr(find_library, &search) == 1 ? 0 : -1;
}

#endif
}
