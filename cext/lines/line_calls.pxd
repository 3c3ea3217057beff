"""Linux calls of the thread that reads lines: open, GPIO levels, connect, and presence checks."""

cdef extern from *:
    """
    #ifndef _GNU_SOURCE
    #define _GNU_SOURCE
    #endif
    #include <errno.h>
    #include <fcntl.h>
    #include <netinet/in.h>
    #include <netinet/tcp.h>
    #include <poll.h>
    #include <stdint.h>
    #include <string.h>
    #include <sys/file.h>
    #include <sys/ioctl.h>
    #include <sys/socket.h>
    #include <unistd.h>
    /* Open a line again, for exclusive use; -1 on failure. */
    static inline int tw_open_line(const char *path, int mine) {
        int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (fd >= 0 && mine && flock(fd, LOCK_EX | LOCK_NB) != 0) {
            close(fd);
            return -1;
        }
        return fd;
    }
    /* GPIO_V2_LINE_GET_VALUES_IOCTL and GPIO_V2_LINE_SET_VALUES_IOCTL of <linux/gpio.h>, for line 0 of a request. */
    struct tw_line_values { uint64_t bits, mask; };
    static inline int tw_gpio_level(int fd) {
        struct tw_line_values values = {0, 1};
        return ioctl(fd, _IOWR(0xB4, 0x0E, struct tw_line_values), &values) == 0 ? (int)(values.bits & 1) : -1;
    }
    static inline int tw_set_gpio(int fd, int value) {
        struct tw_line_values values = {value != 0, 1};
        char level = value != 0;
        if (ioctl(fd, _IOWR(0xB4, 0x0F, struct tw_line_values), &values) == 0)
            return 0;
        if (errno != ENOTTY)
            return -1;
        return send(fd, &level, 1, MSG_NOSIGNAL | MSG_DONTWAIT) == 1 ? 0 : -1;      /* an emulated line is a socket */
    }
    /* Whether a line was disconnected without an event: Linux before 6.6 reports none for an unplugged GPIO chip. Does
    not access the chip. */
    static inline int tw_hung_up(int fd) {
        struct pollfd file = {fd, 0, 0};
        return poll(&file, 1, 0) > 0 && (file.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0;
    }
    /* Begin a connection; -1 if that fails at once. A silent loss of the peer is detected after some 4 s. */
    static void tw_keep_alive(int fd) {
        int one = 1, probes = 3;
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
        setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &one, sizeof one);
        setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &one, sizeof one);
        setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &one, sizeof one);
        setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &probes, sizeof probes);
    }
    static inline int tw_begin_connection(const void *peer, unsigned length) {
        int fd = socket(((const struct sockaddr *)peer)->sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        if (fd < 0)
            return -1;
        tw_keep_alive(fd);
        if (connect(fd, peer, length) != 0 && errno != EINPROGRESS) {
            close(fd);
            return -1;
        }
        return fd;
    }
    /* Whether a connection is established, and not to itself, which is possible for a free port of this computer. */
    static inline int tw_is_connected(int fd) {
        struct sockaddr_storage here, there;
        socklen_t size = sizeof here, other = sizeof there, of_error = sizeof(int);
        int error = 0;
        memset(&here, 0, sizeof here);
        memset(&there, 0, sizeof there);
        return getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &of_error) == 0 && error == 0
            && getsockname(fd, (struct sockaddr *)&here, &size) == 0
            && getpeername(fd, (struct sockaddr *)&there, &other) == 0
            && (size != other || memcmp(&here, &there, size) != 0);
    }
    static inline int tw_peer_of(int fd, void *peer) {                  /* into a sockaddr_storage */
        socklen_t size = sizeof(struct sockaddr_storage);
        return getpeername(fd, peer, &size) == 0 ? (int)size : -1;
    }
    void *memmem(const void *, size_t, const void *, size_t);
    int dup3(int, int, int);
    static inline int tw_holds(const void *data, size_t length, const void *part, size_t of_part) {
        return memmem(data, length, part, of_part) != NULL;
    }
    static inline int tw_dup3(int from, int to) { return dup3(from, to, O_CLOEXEC); }
    """
    int gpio_level "tw_gpio_level"(int fd) noexcept nogil
    int set_gpio "tw_set_gpio"(int fd, int value) noexcept nogil
    int open_line "tw_open_line"(const char *path, int mine) noexcept nogil
    int put_in_place "tw_dup3"(int one, int other) noexcept nogil
    bint holds "tw_holds"(const void *data, size_t length, const void *part, size_t of_part) noexcept nogil
    bint hung_up "tw_hung_up"(int fd) noexcept nogil
    void keep_alive "tw_keep_alive"(int fd) noexcept nogil
    int begin_connection "tw_begin_connection"(const void *peer, unsigned length) noexcept nogil
    bint is_connected "tw_is_connected"(int fd) noexcept nogil
    int peer_of "tw_peer_of"(int fd, void *peer) noexcept nogil
