/* A machine that turns against the process it runs: a wall clock that is set, a disk that takes its time to sync, a file
 * system that was made read-only under open files. Preloaded; ADVERSE names a file with three numbers, which may change at any
 * time: seconds to add to the wall clock, milliseconds that each sync takes longer, and whether a database can be written.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

struct adversity {
    long clock_s, sync_ms;
    int read_only;
};

static struct adversity now(void) {
    struct adversity found = {0, 0, 0};
    char text[64];
    const char *path = getenv("ADVERSE");
    int before = errno, fd = path == NULL ? -1 : (int)syscall(SYS_openat, AT_FDCWD, path, O_RDONLY | O_CLOEXEC);
    if (fd >= 0) {
        ssize_t length = syscall(SYS_read, fd, text, sizeof text - 1);
        syscall(SYS_close, fd);
        text[length < 0 ? 0 : length] = 0;
        sscanf(text, "%ld %ld %d", &found.clock_s, &found.sync_ms, &found.read_only);
    }
    errno = before;
    return found;
}

static int is_wall(clockid_t clock) { return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE; }

int clock_gettime(clockid_t clock, struct timespec *time) {
    int result = (int)syscall(SYS_clock_gettime, clock, time);
    if (result == 0 && is_wall(clock)) time->tv_sec += now().clock_s;
    return result;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone) {
    struct timespec exact;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &exact) != 0) return -1;
    time->tv_sec = exact.tv_sec;
    time->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *result) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (result != NULL) *result = exact.tv_sec;
    return exact.tv_sec;
}

/* Whether this is a part of a database that cannot be written. */
static int is_refused(int fd) {
    char link[64], path[PATH_MAX];
    if (!now().read_only) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    const char *name = strrchr(path, '/');
    return name != NULL && strncmp(name, "/headway.db", 11) == 0;
}

#define REFUSE(fd)                                                                                                             \
    if (is_refused(fd)) {                                                                                                      \
        errno = EROFS;                                                                                                         \
        return -1;                                                                                                             \
    }

ssize_t write(int fd, const void *bytes, size_t count) {
    REFUSE(fd);
    return syscall(SYS_write, fd, bytes, count);
}

ssize_t pwrite(int fd, const void *bytes, size_t count, off_t at) {
    REFUSE(fd);
    return syscall(SYS_pwrite64, fd, bytes, count, at);
}

ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t at) {
    REFUSE(fd);
    return syscall(SYS_pwrite64, fd, bytes, count, at);
}

int ftruncate(int fd, off_t length) {
    REFUSE(fd);
    return (int)syscall(SYS_ftruncate, fd, length);
}

int ftruncate64(int fd, off64_t length) {
    REFUSE(fd);
    return (int)syscall(SYS_ftruncate, fd, length);
}

static void take_time(void) {
    long ms = now().sync_ms;
    struct timespec time = {ms / 1000, ms % 1000 * 1000000};
    while (ms > 0 && nanosleep(&time, &time) != 0) {}
}

int fsync(int fd) {
    take_time();
    return (int)syscall(SYS_fsync, fd);
}

int fdatasync(int fd) {
    take_time();
    return (int)syscall(SYS_fdatasync, fd);
}
