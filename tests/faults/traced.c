/* Writes down, in the order in which they happen, what the process writes to its write-ahead log, when that is synced, and
 * what it answers. Preloaded; TRACED_LOG names the file, which gets a line each: `written`, `synced`, or an answer's status.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#define NEXT(result, name, ...) ((result(*)(__VA_ARGS__))dlsym(RTLD_NEXT, name))

static void say(const char *what, size_t length) {
    char line[16];
    int fd = open(getenv("TRACED_LOG"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    int all = snprintf(line, sizeof line, "%.*s\n", (int)length, what);
    if (fd < 0 || NEXT(ssize_t, "write", int, const void *, size_t)(fd, line, all) != all) abort();
    close(fd);
}

static int is_log(int fd) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path);
    return length > 4 && memcmp(path + length - 4, "-wal", 4) == 0;
}

/* Said before it is begun, as a sync is said after it has ended. */
static void out(int fd, const void *bytes, size_t length) {
    static const char answer[] = "HTTP/1.1 ";
    if (is_log(fd)) say("written", 7);
    else if (length > 12 && memcmp(bytes, answer, 9) == 0) say((const char *)bytes + 9, 3);
}

ssize_t write(int fd, const void *bytes, size_t length) {
    out(fd, bytes, length);
    return NEXT(ssize_t, "write", int, const void *, size_t)(fd, bytes, length);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    if (count > 0) out(fd, parts[0].iov_base, parts[0].iov_len);
    return NEXT(ssize_t, "writev", int, const struct iovec *, int)(fd, parts, count);
}

ssize_t send(int fd, const void *bytes, size_t length, int flags) {
    out(fd, bytes, length);
    return NEXT(ssize_t, "send", int, const void *, size_t, int)(fd, bytes, length, flags);
}

ssize_t pwrite64(int fd, const void *bytes, size_t length, off64_t at) {
    out(fd, bytes, length);
    return NEXT(ssize_t, "pwrite64", int, const void *, size_t, off64_t)(fd, bytes, length, at);
}

ssize_t pwrite(int fd, const void *bytes, size_t length, off_t at) {
    out(fd, bytes, length);
    return NEXT(ssize_t, "pwrite", int, const void *, size_t, off_t)(fd, bytes, length, at);
}

static int synced(const char *name, int fd) {
    int result = NEXT(int, name, int)(fd);
    if (result == 0 && is_log(fd)) say("synced", 6);
    return result;
}

int fsync(int fd) { return synced("fsync", fd); }

int fdatasync(int fd) { return synced("fdatasync", fd); }
