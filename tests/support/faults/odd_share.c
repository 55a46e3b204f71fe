/* A share whose hard links are not those of a disk: preloaded (LD_PRELOAD), below the folder ODD_SHARE every link fails with EPERM, as
   on FAT and on most FUSE mounts; with ODD_LINKS=overwrite it replaces the file of that name instead of failing. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int refused(const char *to) {
    const char *folder = getenv("ODD_SHARE"), *how = getenv("ODD_LINKS");
    if (!folder || strncmp(to, folder, strlen(folder))) return 0;
    if (how && !strcmp(how, "overwrite")) {
        unlink(to);
        return 0;
    }
    errno = EPERM;
    return 1;
}

int linkat(int from_folder, const char *from, int to_folder, const char *to, int flags) {
    static int (*real)(int, const char *, int, const char *, int);
    if (!real) real = dlsym(RTLD_NEXT, "linkat");
    return refused(to) ? -1 : real(from_folder, from, to_folder, to, flags);
}

int link(const char *from, const char *to) { return linkat(AT_FDCWD, from, AT_FDCWD, to, 0); }
