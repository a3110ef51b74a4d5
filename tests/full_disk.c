/* Preloaded: in the folder FULL_IN every write from the FULL_FROM-th on fails, as on a full disk. Python's files, Arrow's
   (C++) and rerun's (Rust) all go through these four. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

static long written;

static int is_full(int file)
{
    const char *folder = getenv("FULL_IN"), *from = getenv("FULL_FROM");
    char link[64], path[4096];
    if (!folder || !from)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    if (strncmp(path, folder, strlen(folder)))
        return 0;
    if (__atomic_fetch_add(&written, 1, __ATOMIC_SEQ_CST) < atol(from))
        return 0;
    errno = ENOSPC;
    return 1;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
ssize_t write(int file, const void *data, size_t size) { return is_full(file) ? -1 : REAL(write)(file, data, size); }
ssize_t writev(int file, const struct iovec *parts, int count) { return is_full(file) ? -1 : REAL(writev)(file, parts, count); }
ssize_t pwrite(int file, const void *data, size_t size, off_t at) { return is_full(file) ? -1 : REAL(pwrite)(file, data, size, at); }
ssize_t pwrite64(int file, const void *data, size_t size, off64_t at) { return is_full(file) ? -1 : REAL(pwrite64)(file, data, size, at); }
