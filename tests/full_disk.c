/* Preloaded: in the folder FULL_IN every change from the FULL_FROM-th on fails, as FULL_AS (an error's number) says:
   ENOSPC and EDQUOT where something grows, EACCES where a name is opened, made, moved or removed, EROFS at all of it.
   Python's files, Arrow's (C++) and rerun's (Rust) all go through these functions of C's library. */
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

enum { GROWS = 1, NAMES = 2 };
static long changes;

static int as(void) { return getenv("FULL_AS") ? atoi(getenv("FULL_AS")) : ENOSPC; }

static int concerns(int kind)
{
    int which = as() == EROFS ? GROWS | NAMES : as() == EACCES ? NAMES : GROWS;
    return which & kind;
}

/* Whether a path, from a folder that is open, lies in FULL_IN. */
static int is_inside(int folder, const char *path)
{
    const char *in = getenv("FULL_IN");
    char link[64], from[4096] = "";
    if (!in || !getenv("FULL_FROM"))
        return 0;
    if (path && path[0] == '/')
        return !strncmp(path, in, strlen(in));
    if (folder == AT_FDCWD)
        snprintf(link, sizeof link, "/proc/self/cwd");
    else
        snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
    ssize_t length = readlink(link, from, sizeof from - 1);
    if (length < 0)
        return 0;
    from[length] = 0;
    return !strncmp(from, in, strlen(in));
}

static int fails(int kind, int folder, const char *path)
{
    if (!concerns(kind) || !is_inside(folder, path))
        return 0;
    if (__atomic_fetch_add(&changes, 1, __ATOMIC_SEQ_CST) < atol(getenv("FULL_FROM")))
        return 0;
    errno = as();
    return 1;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define HERE AT_FDCWD
ssize_t write(int file, const void *data, size_t size) { return fails(GROWS, file, 0) ? -1 : REAL(write)(file, data, size); }
ssize_t writev(int file, const struct iovec *parts, int count) { return fails(GROWS, file, 0) ? -1 : REAL(writev)(file, parts, count); }
ssize_t pwrite(int file, const void *data, size_t size, off_t at) { return fails(GROWS, file, 0) ? -1 : REAL(pwrite)(file, data, size, at); }
ssize_t pwrite64(int file, const void *data, size_t size, off64_t at) { return fails(GROWS, file, 0) ? -1 : REAL(pwrite64)(file, data, size, at); }
int mkdir(const char *path, mode_t mode) { return fails(GROWS | NAMES, HERE, path) ? -1 : REAL(mkdir)(path, mode); }
int mkdirat(int folder, const char *path, mode_t mode) { return fails(GROWS | NAMES, folder, path) ? -1 : REAL(mkdirat)(folder, path, mode); }
int rename(const char *from, const char *to) { return fails(NAMES, HERE, to) ? -1 : REAL(rename)(from, to); }
int renameat(int a, const char *from, int b, const char *to) { return fails(NAMES, b, to) ? -1 : REAL(renameat)(a, from, b, to); }
int renameat2(int a, const char *from, int b, const char *to, unsigned how) { return fails(NAMES, b, to) ? -1 : REAL(renameat2)(a, from, b, to, how); }
int link(const char *from, const char *to) { return fails(NAMES, HERE, to) ? -1 : REAL(link)(from, to); }
int linkat(int a, const char *from, int b, const char *to, int how) { return fails(NAMES, b, to) ? -1 : REAL(linkat)(a, from, b, to, how); }
int unlink(const char *path) { return fails(NAMES, HERE, path) ? -1 : REAL(unlink)(path); }
int unlinkat(int folder, const char *path, int how) { return fails(NAMES, folder, path) ? -1 : REAL(unlinkat)(folder, path, how); }
int rmdir(const char *path) { return fails(NAMES, HERE, path) ? -1 : REAL(rmdir)(path); }

/* Who may write is asked without counting: from the same change on, nobody. */
static int is_denied(int folder, const char *path, int how)
{
    if (!(how & W_OK) || !concerns(NAMES) || !is_inside(folder, path) || changes < atol(getenv("FULL_FROM")))
        return 0;
    errno = as();
    return 1;
}
int access(const char *path, int how) { return is_denied(HERE, path, how) ? -1 : REAL(access)(path, how); }
int faccessat(int folder, const char *path, int how, int flags) { return is_denied(folder, path, how) ? -1 : REAL(faccessat)(folder, path, how, flags); }

/* Opened to read never fails; to write a file that is there, by its name alone. */
static int is_kept(int folder, const char *path, int flags)
{
    if ((flags & O_ACCMODE) == O_RDONLY && !(flags & (O_CREAT | O_TRUNC)))
        return 0;
    return fails(flags & O_CREAT ? GROWS | NAMES : NAMES, folder, path);
}

static mode_t mode_of(int flags, va_list more) { return flags & (O_CREAT | __O_TMPFILE) ? va_arg(more, mode_t) : 0; }

#define OPENS(name) \
    int name(const char *path, int flags, ...) \
    { \
        va_list more; \
        va_start(more, flags); \
        mode_t mode = mode_of(flags, more); \
        va_end(more); \
        return is_kept(HERE, path, flags) ? -1 : REAL(name)(path, flags, mode); \
    }
#define OPENS_AT(name) \
    int name(int folder, const char *path, int flags, ...) \
    { \
        va_list more; \
        va_start(more, flags); \
        mode_t mode = mode_of(flags, more); \
        va_end(more); \
        return is_kept(folder, path, flags) ? -1 : REAL(name)(folder, path, flags, mode); \
    }
OPENS(open)
OPENS(open64)
OPENS_AT(openat)
OPENS_AT(openat64)
#define FOPENS(name) \
    FILE *name(const char *path, const char *how) \
    { \
        return strpbrk(how, "wa+") && fails(GROWS | NAMES, HERE, path) ? NULL : REAL(name)(path, how); \
    }
FOPENS(fopen)
FOPENS(fopen64)
