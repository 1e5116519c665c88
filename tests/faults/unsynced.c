/* A disk that forgets: of every file of a database it keeps, in another folder, what was there at its last sync. What was
 * written since is lost with the power. Preloaded into the process that owns the database.
 *
 * UNSYNCED_KEPT names the folder. With UNSYNCED_LIES set, nothing is kept and every sync is said to have been made.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <unistd.h>

static void fail(const char *what) {
    perror(what);
    abort();
}

/* Copies the file behind fd, if it is a part of a database: first under another name, so that a copy is whole or not there. */
static void keep(int fd) {
    const char *folder = getenv("UNSYNCED_KEPT");
    char link[64], path[PATH_MAX], whole[PATH_MAX + 64], part[PATH_MAX + 80];
    if (folder == NULL || getenv("UNSYNCED_LIES") != NULL) return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) fail("readlink");
    path[length] = 0;
    const char *name = strrchr(path, '/');
    if (name == NULL || strncmp(name, "/headway.db", 11) != 0) return;
    snprintf(whole, sizeof whole, "%s%s", folder, name);
    snprintf(part, sizeof part, "%s.%d", whole, (int)gettid());
    int from = open(path, O_RDONLY | O_CLOEXEC), to = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    struct stat now;
    if (from < 0 || to < 0 || fstat(from, &now) < 0) fail("open");
    for (off_t done = 0; done < now.st_size;) {
        ssize_t sent = sendfile(to, from, &done, now.st_size - done);
        if (sent < 0) fail("sendfile");
        if (sent == 0) break;
    }
    close(from);
    close(to);
    if (rename(part, whole) < 0) fail("rename");
}

static int synced(const char *name, int fd) {
    int (*sync)(int) = (int (*)(int))dlsym(RTLD_NEXT, name);
    int result = sync(fd);
    if (result == 0) keep(fd);
    return result;
}

int fsync(int fd) { return synced("fsync", fd); }

int fdatasync(int fd) { return synced("fdatasync", fd); }
