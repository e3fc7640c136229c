//! The command's memory allocator. It is not part of the library, whose users choose their own.
//!
//! A sample takes many images of a megabyte, which are allocated and freed again and again. The allocator of glibc
//! returns such memory to the kernel each time, and the kernel clears it when it is needed again: up to a third of the
//! time. Settings of the allocator prevent that.

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod kept {
    /// Size up to which allocations come from memory that is kept, bytes: the largest value that glibc accepts.
    const LARGEST: libc::c_int = 32 << 20;
    /// Free memory that is kept and not returned to the kernel, bytes.
    const FREE: libc::c_int = 256 << 20;

    /// Keeps freed memory for later allocations. Must be called before there are other threads.
    pub fn keep_freed() {
        #[allow(unsafe_code, reason = "glibc has no safe interface for these settings")]
        // SAFETY: `mallopt` takes two numbers. Its only precondition is that no other thread allocates meanwhile. It
        // refuses a setting that it does not know, and changes nothing then.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST);
            libc::mallopt(libc::M_TRIM_THRESHOLD, FREE);
        }
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
mod kept {
    #[global_allocator]
    static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

    /// Does nothing: this allocator keeps freed memory by itself.
    pub fn keep_freed() {}
}

pub use kept::keep_freed;
