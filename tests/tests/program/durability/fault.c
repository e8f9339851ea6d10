/* Faults for the program under test, put between it and the C library: cc -shared -fPIC -o fault.so fault.c -ldl
 *
 *   FAULT_CALL=write|fsync|rename|open   which call fails with EIO, from the N-th one (FAULT_AFTER) on, for files whose
 *                                        name has FAULT_NAME in it
 *   FAULT_CLOCK=1                        every look at a clock, also at the one that should never go back, is off by up to
 *                                        an hour, another way every time
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static int fails(const char *call, const char *name) {
    static _Atomic int seen;
    const char *wanted = getenv("FAULT_CALL"), *part = getenv("FAULT_NAME"), *after = getenv("FAULT_AFTER");
    if (!wanted || strcmp(wanted, call) || !name || (part && !strstr(name, part)))
        return 0;
    return ++seen > (after ? atoi(after) : 0);
}

static const char *name_of(int file, char *path, size_t size) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, size - 1);
    if (length < 0)
        return NULL;
    path[length] = 0;
    return path;
}

#define NEXT(result, name, ...) ((result(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name))

ssize_t write(int file, const void *bytes, size_t count) {
    char path[4096];
    if (getenv("FAULT_CALL") && fails("write", name_of(file, path, sizeof path))) {
        errno = EIO;
        return -1;
    }
    return NEXT(ssize_t, write, int, const void *, size_t)(file, bytes, count);
}

int fsync(int file) {
    char path[4096];
    if (fails("fsync", name_of(file, path, sizeof path))) {
        errno = EIO;
        return -1;
    }
    return NEXT(int, fsync, int)(file);
}

int rename(const char *from, const char *to) {
    if (fails("rename", to)) {
        errno = EIO;
        return -1;
    }
    return NEXT(int, rename, const char *, const char *)(from, to);
}

int open64(const char *name, int flags, ...) {
    va_list list;
    va_start(list, flags);
    mode_t mode = va_arg(list, int);
    va_end(list);
    if (fails("open", name)) {
        errno = EIO;
        return -1;
    }
    return NEXT(int, open64, const char *, int, mode_t)(name, flags, mode);
}

int clock_gettime(clockid_t clock, struct timespec *time) {
    static _Atomic uint32_t state = 1;
    int result = NEXT(int, clock_gettime, clockid_t, struct timespec *)(clock, time);
    if (result == 0 && getenv("FAULT_CLOCK")) {
        state = state * 1664525u + 1013904223u;
        time->tv_sec += (long)(state >> 16) % 7200 - 3600;
        if (time->tv_sec < 0)
            time->tv_sec = 0;
    }
    return result;
}
