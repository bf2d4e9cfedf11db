/* Library for LD_PRELOAD that moves the wall clock of a process, and no other clock.
 *
 * The file HELIOS_CHAOS_CLOCK holds the offset in nanoseconds as one int64. It is mapped into
 * memory, so a new offset holds at once in all processes.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const int64_t NONE = 0;
static const volatile int64_t *offset = &NONE;

__attribute__((constructor)) static void map_offset(void) {
    const char *path = getenv("HELIOS_CHAOS_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *mapped = mmap(NULL, sizeof(int64_t), PROT_READ, MAP_SHARED, file, 0);
    close(file);
    if (mapped != MAP_FAILED) offset = mapped;
}

static void move(struct timespec *at) {
    int64_t ns = at->tv_nsec + *offset % 1000000000;
    at->tv_sec += *offset / 1000000000;
    if (ns < 0) ns += 1000000000, at->tv_sec -= 1;
    if (ns >= 1000000000) ns -= 1000000000, at->tv_sec += 1;
    at->tv_nsec = ns;
}

int clock_gettime(clockid_t clock, struct timespec *at) {
    int failed = (int)syscall(SYS_clock_gettime, clock, at);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) move(at);
    return failed;
}

int gettimeofday(struct timeval *at, void *zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    at->tv_sec = now.tv_sec;
    at->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *at) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (at) *at = now.tv_sec;
    return now.tv_sec;
}
