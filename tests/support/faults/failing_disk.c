/* A disk that fails: preloaded (LD_PRELOAD) it counts what a program asks of the files below one folder, and has the Nth of it fail.

   What is counted: opening a file to write or to make it, writing, cutting and lengthening, syncing, renaming, removing, making a
   folder. `failing_arm(folder, nth, error, again)` begins to count in this process; `again` 1 has everything after the Nth fail
   too, as far as `error` can come of it: a full disk (ENOSPC) still syncs, renames and removes. A process that is started with
   FAILING_FOLDER, FAILING_NTH, FAILING_ERROR and FAILING_AGAIN in its environment is armed from its first step.
   `failing_count()` says how many there were, `failing_fired()` how many of them failed. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static char folder[4096];
static long nth, count, fired;
static int error, again;

void failing_arm(const char *where, long which, int what, int go_on) {
    snprintf(folder, sizeof folder, "%s", where);
    nth = which, error = what, again = go_on, count = fired = 0;
}

long failing_count(void) { return count; }
long failing_fired(void) { return fired; }

__attribute__((constructor)) static void begin(void) {
    const char *where = getenv("FAILING_FOLDER");
    if (where) failing_arm(where, atol(getenv("FAILING_NTH")), atoi(getenv("FAILING_ERROR")), atoi(getenv("FAILING_AGAIN")));
}

static int below(const char *path) {
    size_t length = strlen(folder);
    return length && path && !strncmp(path, folder, length) && (path[length] == '/' || !path[length]);
}

static int open_below(int descriptor) {
    char link[64], path[4096];
    if (!*folder) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return below(path);
}

/* Whether this call is to fail; `grows`: a full disk refuses it. */
static int fails(int counts, int grows) {
    if (!counts) return 0;
    long mine = __atomic_add_fetch(&count, 1, __ATOMIC_SEQ_CST);
    int can = error != ENOSPC || grows;
    if (!(mine == nth || (again && mine > nth)) || !can) return 0;
    __atomic_add_fetch(&fired, 1, __ATOMIC_SEQ_CST);
    errno = error;
    return 1;
}

#define REAL(name) ((typeof(&name))dlsym(RTLD_NEXT, #name))
#define MODE(flags) mode_t mode = 0; \
    if ((flags) & (O_CREAT | O_TMPFILE)) { va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); }
#define MAKES(flags) ((flags) & O_CREAT)
#define WRITES(flags) ((flags) & (O_WRONLY | O_RDWR | O_CREAT))

int open(const char *path, int flags, ...) {
    MODE(flags)
    return fails(below(path) && WRITES(flags), MAKES(flags)) ? -1 : REAL(open)(path, flags, mode);
}
int open64(const char *path, int flags, ...) {
    MODE(flags)
    return fails(below(path) && WRITES(flags), MAKES(flags)) ? -1 : REAL(open64)(path, flags, mode);
}
int openat(int at, const char *path, int flags, ...) {
    MODE(flags)
    return fails(below(path) && WRITES(flags), MAKES(flags)) ? -1 : REAL(openat)(at, path, flags, mode);
}
int openat64(int at, const char *path, int flags, ...) {
    MODE(flags)
    return fails(below(path) && WRITES(flags), MAKES(flags)) ? -1 : REAL(openat64)(at, path, flags, mode);
}
ssize_t write(int to, const void *data, size_t length) { return fails(open_below(to), 1) ? -1 : REAL(write)(to, data, length); }
ssize_t writev(int to, const struct iovec *data, int pieces) {
    return fails(open_below(to), 1) ? -1 : REAL(writev)(to, data, pieces);
}
ssize_t pwrite(int to, const void *data, size_t length, off_t at) {
    return fails(open_below(to), 1) ? -1 : REAL(pwrite)(to, data, length, at);
}
ssize_t pwrite64(int to, const void *data, size_t length, off64_t at) {
    return fails(open_below(to), 1) ? -1 : REAL(pwrite64)(to, data, length, at);
}
int fsync(int of) { return fails(open_below(of), 0) ? -1 : REAL(fsync)(of); }
int fdatasync(int of) { return fails(open_below(of), 0) ? -1 : REAL(fdatasync)(of); }
int ftruncate(int of, off_t length) { return fails(open_below(of), 1) ? -1 : REAL(ftruncate)(of, length); }
int ftruncate64(int of, off64_t length) { return fails(open_below(of), 1) ? -1 : REAL(ftruncate64)(of, length); }
int truncate(const char *path, off_t length) { return fails(below(path), 1) ? -1 : REAL(truncate)(path, length); }
int truncate64(const char *path, off64_t length) { return fails(below(path), 1) ? -1 : REAL(truncate64)(path, length); }
int posix_fallocate64(int of, off64_t at, off64_t length) {
    return fails(open_below(of), 1) ? error : REAL(posix_fallocate64)(of, at, length);
}
int rename(const char *old, const char *new) { return fails(below(new), 0) ? -1 : REAL(rename)(old, new); }
int unlink(const char *path) { return fails(below(path), 0) ? -1 : REAL(unlink)(path); }
int rmdir(const char *path) { return fails(below(path), 0) ? -1 : REAL(rmdir)(path); }
int mkdir(const char *path, mode_t mode) { return fails(below(path), 1) ? -1 : REAL(mkdir)(path, mode); }
