/* Memory that is refused: preloaded (LD_PRELOAD) it counts what a program asks for and refuses the Nth request.

   With PYTHONMALLOC=malloc each object of Python is such a request, too. A process that is started with FAILING_ALLOC in its
   environment (a folder) and has the word of FAILING_ALLOC_IN in its command line, as `jbclog.guard`, has a page of its own
   there, shared with who watches it: a file by the number of the process, of four 64-bit numbers. `wait`: how many requests are
   still granted; from when somebody writes it there, it counts down, and at 0 the next `many` requests are refused (many < 0: all
   from then on). `asked` and `refused` count. Before that, nothing is refused. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

struct page {
    int64_t wait, many, asked, refused;
};

static struct page *page;

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);

static int is_meant(const char *word) {
    char line[8192];
    int from = open("/proc/self/cmdline", O_RDONLY | O_CLOEXEC);
    ssize_t length = from < 0 ? 0 : read(from, line, sizeof line);
    if (from >= 0) close(from);
    return length > 0 && memmem(line, length, word, strlen(word)) != NULL;
}

__attribute__((constructor)) static void begin(void) {
    const char *folder = getenv("FAILING_ALLOC"), *word = getenv("FAILING_ALLOC_IN");
    char path[4096];
    if (!folder || !word || !is_meant(word)) return;
    snprintf(path, sizeof path, "%s/%d", folder, (int)getpid());
    int file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (file < 0 || ftruncate(file, sizeof(struct page))) _exit(99);
    struct page *mine = mmap(NULL, sizeof(struct page), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (mine == MAP_FAILED) _exit(99);
    page = mine;
}

static int is_refused(void) {
    if (!page) return 0;
    __atomic_add_fetch(&page->asked, 1, __ATOMIC_RELAXED);
    if (__atomic_load_n(&page->wait, __ATOMIC_RELAXED) > 0) {
        if (__atomic_sub_fetch(&page->wait, 1, __ATOMIC_SEQ_CST) != 0) return 0;
        __atomic_store_n(&page->wait, -1, __ATOMIC_SEQ_CST);
    }
    if (__atomic_load_n(&page->wait, __ATOMIC_RELAXED) == 0) return 0;
    int64_t many = __atomic_load_n(&page->many, __ATOMIC_RELAXED);
    while (many > 0 && !__atomic_compare_exchange_n(&page->many, &many, many - 1, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) {}
    if (many == 0) return 0;
    __atomic_add_fetch(&page->refused, 1, __ATOMIC_RELAXED);
    errno = ENOMEM;
    return 1;
}

void *malloc(size_t size) { return is_refused() ? NULL : __libc_malloc(size); }
void *calloc(size_t count, size_t size) { return is_refused() ? NULL : __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { return size && is_refused() ? NULL : __libc_realloc(old, size); }
void *memalign(size_t alignment, size_t size) { return is_refused() ? NULL : __libc_memalign(alignment, size); }
void *aligned_alloc(size_t alignment, size_t size) { return is_refused() ? NULL : __libc_memalign(alignment, size); }
int posix_memalign(void **found, size_t alignment, size_t size) {
    void *made = is_refused() ? NULL : __libc_memalign(alignment, size);
    if (made) *found = made;
    return made ? 0 : ENOMEM;
}
